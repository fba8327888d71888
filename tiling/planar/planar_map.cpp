#include "tiling/planar/planar_map.h"

#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <utility>

#include "tiling/clipmap/parent.h"

namespace overfly::tiling {
namespace {

// Coded tiles that wait for the disk: little, so that a slow disk slows the map instead of filling memory.
constexpr std::size_t kQueueBytes = 1u << 20;

double threadCpu_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

PlaneBox boxOf(const std::array<Eigen::Vector2d, 4>& polygon) {
  PlaneBox box{polygon[0].x(), polygon[0].y(), polygon[0].x(), polygon[0].y()};
  for (const Eigen::Vector2d& corner : polygon)
    box = {std::min(box.west, corner.x()), std::min(box.north, corner.y()), std::max(box.east, corner.x()),
           std::max(box.south, corner.y())};
  return box;
}

constexpr std::size_t kSpareImages = 4;
constexpr std::size_t kSpareTiles = 16;
constexpr std::size_t kMostGone = 4096;

std::size_t halfBytes(std::size_t drawn_bytes) { return drawn_bytes / 8 / 4 * 6; }  // 6 for each texel

}  // namespace

Result<std::unique_ptr<PlanarMap>> PlanarMap::create(MapStore store, const PlanarOptions& options) {
  const MapMeta& meta = store.meta();
  auto lattice = geo::TileLattice::parse(meta.lattice);
  if (!lattice) return tl::unexpected(lattice.error());
  if (meta.tile_size < PlanarPlan::kBlock || meta.tile_size % PlanarPlan::kBlock != 0)
    return fail(ErrorCode::BadSettings,
                fmt::format("tiles of {} texels cannot be made: take a multiple of {}", meta.tile_size,
                            PlanarPlan::kBlock));
  auto reader = store.reader();
  if (!reader) return tl::unexpected(reader.error());
  return std::unique_ptr<PlanarMap>(
      new PlanarMap(std::move(store), std::move(*reader), std::move(*lattice), options));
}

PlanarMap::PlanarMap(MapStore store, MapReader reader, geo::TileLattice lattice, const PlanarOptions& options)
    : writer_(std::move(store), {.queue_bytes = kQueueBytes, .group_bytes = kQueueBytes / 2}),
      reader_(std::move(reader)),
      lattice_(std::move(lattice)),
      options_(options),
      tile_size_(writer_.meta().tile_size),
      base_zoom_(writer_.meta().base_zoom),
      index_(lattice_),
      scheduler_(base_zoom_, {}),
      spare_pixels_(kSpareImages),
      spare_tiles_(kSpareTiles),
      spare_joined_(static_cast<std::size_t>(std::max(1, options.threads))),
      spare_halves_(options.tile_bytes / 4 / halfBytes(drawnBytes())),
      images_(options.image_bytes),
      workers_(options.threads) {}

PlanarMap::~PlanarMap() = default;

Result<PlanarImagePtr> PlanarMap::decode(const capture::Frame& frame, double gsd_m) {
  const double start = threadCpu_s();
  auto image = decodeForPlane(frame, gsd_m, texel_m_, spare_pixels_.take());
  const std::scoped_lock lock(statistics_mutex_);
  statistics_.decode_s += threadCpu_s() - start;
  ++statistics_.images_loaded;
  if (!image) return tl::unexpected(image.error());
  return PlanarImagePtr(new PlanarImage(std::move(*image)), [this](PlanarImage* gone) {
    const std::unique_ptr<PlanarImage> owner(gone);
    spare_pixels_.give(std::move(gone->rgbx));
  });
}

Result<void> PlanarMap::addFrame(std::uint64_t id, const capture::FramePtr& frame, Loader load) {
  if (!frame->pose) return fail(ErrorCode::BadInput, frame->name + " has no pose");
  auto record =
      makeIndexedFrame(id, frame->camera, *frame->pose, 0, lattice_, options_.anchor_px, options_.height_m);
  if (!record) return tl::unexpected(record.error());
  if (!record->near_vertical) return fail(ErrorCode::BadInput, frame->name + " does not look down");
  if (texel_m_ == 0) {
    const geo::Geodetic place = geo::geodeticFromEcef(frame->pose->position_in_ecef);
    texel_m_ = lattice_.texelSize(base_zoom_, place.lat, place.lon, tile_size_);
  }
  const double gsd_m = record->gsd_m;
  sources_.insert_or_assign(id, Source{gsd_m, std::move(load)});
  index_.insert(std::move(*record));
  ++statistics_.frames;
  arriving_.push_back({id, workers_.post([this, gsd_m, frame] { return decode(*frame, gsd_m); })});
  while (arriving_.size() > static_cast<std::size_t>(std::max(0, options_.ahead)))
    if (auto ok = takeNext(); !ok) return ok;
  return {};
}

// The oldest frame that has arrived: its tiles are marked and made.
Result<void> PlanarMap::takeNext() {
  Arriving arriving = std::move(arriving_.front());
  arriving_.pop_front();
  auto image = workers_.get(arriving.image);
  if (!image) {
    index_.remove(arriving.id);
    sources_.erase(arriving.id);
    return tl::unexpected(image.error());
  }
  const std::size_t bytes = (*image)->bytes();
  images_.insert(arriving.id, std::move(*image), bytes);
  const IndexedFrame& record = *index_.find(arriving.id);
  scheduler_.cover(boxOf(record.footprint));
  const std::vector<geo::TileKey> keys = FrameIndex::tilesUnder(record, base_zoom_);
  // What waits stays in memory: it is coded before this frame's tiles would fill their share together with
  // it.
  const auto fresh = static_cast<std::size_t>(std::ranges::count_if(keys, [&](const geo::TileKey& key) {
    const auto found = drawn_.find(key);
    return found == drawn_.end() || !found->second.waits;
  }));
  if (!waiting_.empty() && (waiting_.size() + fresh) * drawnBytes() > drawnShare())
    if (auto done = finishBatch(); !done) return done;
  if (auto made = drawTiles(arriving.id, keys); !made) return made;
  return updates_ >= options_.batch_updates ? finishBatch() : Result<void>{};
}

// One transaction: the tiles that have changed, and their parents level by level.
Result<void> PlanarMap::finishBatch() {
  updates_ = 0;
  if (auto coded = codeTiles(); !coded) return coded;
  for (;;) {
    std::vector<TileJob> jobs;
    while (auto job = scheduler_.next(now_ns())) jobs.push_back(*job);
    if (jobs.empty()) break;
    if (auto made = makeParents(jobs); !made) return made;
  }
  return batch_.tiles.empty() ? Result<void>{} : submit();
}

Result<void> PlanarMap::drawTiles(std::uint64_t id, std::span<const geo::TileKey> keys) {
  std::vector<std::optional<PlanarPlan>> planned(keys.size());
  auto done = workers_.forEach(keys.size(), [&](std::size_t i) -> Result<void> {
    const double start = threadCpu_s();
    auto candidates = index_.framesForTile(keys[i], options_.height_m, options_.height_m);
    // Frames that have arrived but whose turn is still to come.
    std::erase_if(candidates, [&](const IndexedFrame* frame) {
      return std::any_of(arriving_.begin(), arriving_.end(),
                         [&](const Arriving& arriving) { return arriving.id == frame->id; });
    });
    planned[i].emplace(lattice_, keys[i], tile_size_, options_.height_m, candidates);
    const std::scoped_lock lock(statistics_mutex_);
    statistics_.plan_s += threadCpu_s() - start;
    return {};
  });
  if (!done) return done;

  std::vector<PlanarPlan> plans;
  std::vector<Drawn*> tiles;
  for (auto& plan : planned) {
    const std::vector<std::uint64_t>& frames = plan->frames();
    if (!std::binary_search(frames.begin(), frames.end(), id)) {
      ++statistics_.unchanged;
      continue;
    }
    tiles.push_back(&drawn(*plan));
    plans.push_back(std::move(*plan));
  }
  std::vector<PlanarPlan::Changes> changes(plans.size());
  done = workers_.forEach(plans.size(), [&](std::size_t i) -> Result<void> {
    const double start = threadCpu_s();
    changes[i] = plans[i].prepare(tiles[i]->tile, tiles[i]->marks);
    const std::scoped_lock lock(statistics_mutex_);
    statistics_.plan_s += threadCpu_s() - start;
    return {};
  });
  if (!done) return done;
  std::vector<std::uint8_t> changed(plans.size(), 0);
  done = drawImages(id, plans, changes, tiles, changed);
  if (!done) return done;
  return workers_.forEach(plans.size(), [&](std::size_t i) -> Result<void> {
    const double start = threadCpu_s();
    plans[i].finish(changes[i], tiles[i]->tile, tiles[i]->marks);
    const std::scoped_lock lock(statistics_mutex_);
    statistics_.project_s += threadCpu_s() - start;
    statistics_.tiles += changed[i];
    updates_ += changed[i];
    return {};
  });
}

// What the tiles need of each picture: of those that are in memory first; the others are loaded again, no
// more at a time than there are threads.
Result<void> PlanarMap::drawImages(std::uint64_t newest, std::span<const PlanarPlan> plans,
                                   std::span<const PlanarPlan::Changes> changes,
                                   std::span<Drawn* const> tiles, std::vector<std::uint8_t>& changed) {
  struct Place {
    std::size_t tile, frame;
  };
  std::map<std::uint64_t, std::vector<Place>> needed;
  for (std::size_t i = 0; i < plans.size(); ++i)
    for (std::size_t k = 0; k < changes[i].needed.size(); ++k)
      if (changes[i].needed[k]) needed[plans[i].frames()[k]].push_back({i, k});
  const auto draw = [&](const std::vector<Place>& places, const PlanarImage& image) {
    return workers_.forEach(places.size(), [&](std::size_t n) -> Result<void> {
      const double start = threadCpu_s();
      const auto [i, k] = places[n];
      if (plans[i].draw(changes[i], k, image, tiles[i]->marks, tiles[i]->tile)) changed[i] = 1;
      const std::scoped_lock lock(statistics_mutex_);
      statistics_.project_s += threadCpu_s() - start;
      return {};
    });
  };
  std::vector<std::uint64_t> missing;
  for (const auto& [id, places] : needed) {
    const PlanarImagePtr image = images_.find(id);
    if (image == nullptr)
      missing.push_back(id);
    else if (auto done = draw(places, *image); !done)
      return done;
  }
  const auto most = static_cast<std::size_t>(std::max(1, options_.threads));
  for (std::size_t first = 0; first < missing.size(); first += most) {
    std::vector<PlanarImagePtr> loaded(std::min(most, missing.size() - first));
    auto done = workers_.forEach(loaded.size(), [&](std::size_t n) -> Result<void> {
      const Source& source = sources_.at(missing[first + n]);
      auto frame = source.load();
      if (!frame) return tl::unexpected(frame.error());
      auto image = decode(**frame, source.gsd_m);
      if (!image) return tl::unexpected(image.error());
      loaded[n] = std::move(*image);
      return {};
    });
    if (!done) return done;
    for (std::size_t n = 0; n < loaded.size(); ++n) {
      const std::uint64_t id = missing[first + n];
      if (done = draw(needed.at(id), *loaded[n]); !done) return done;
      const std::size_t bytes = loaded[n]->bytes();
      (void)images_.find(newest);  // the next frame's neighbour: not the one to go
      images_.insert(id, std::move(loaded[n]), bytes);
    }
  }
  return {};
}

// The tile to draw on, which is to be coded with this batch.
PlanarMap::Drawn& PlanarMap::drawn(const PlanarPlan& plan) {
  const auto [at, fresh] = drawn_.try_emplace(plan.key());
  Drawn& tile = at->second;
  if (fresh) {
    tile.tile = plan.blank(spare_tiles_.take());
    tile.marks = plan.noMarks();
    tile.place = drawn_order_.insert(drawn_order_.end(), plan.key());
  } else {
    drawn_order_.splice(drawn_order_.end(), drawn_order_, tile.place);
  }
  if (!std::exchange(tile.waits, true)) waiting_.push_back(plan.key());
  // What is older and coded can be drawn again from its frames.
  for (auto key = drawn_order_.begin();
       key != drawn_order_.end() && drawn_.size() * drawnBytes() > drawnShare();) {
    const auto old = drawn_.find(*key++);
    if (old->second.waits) continue;
    spare_tiles_.give(std::move(old->second.tile));
    drawn_order_.erase(old->second.place);
    drawn_.erase(old);
  }
  return tile;
}

std::size_t PlanarMap::drawnBytes() const {
  return 8 * static_cast<std::size_t>(tile_size_) * static_cast<std::size_t>(tile_size_);
}

// A tile for the store, and what its parent needs of it: colours as readers will decode them, so that a
// parent is a function of what is stored, whether its children come from memory or from the store.
Result<PlanarMap::Coded> PlanarMap::code(Tile& tile, double& encode_s, double& parents_s) {
  const double start = threadCpu_s();
  auto write = encodeTile(tile, options_.encoding);
  if (!write) return tl::unexpected(write.error());
  const double encoded = threadCpu_s();
  std::vector<std::uint8_t> exact;
  for (const EncodedLayer& layer : write->layers) {
    if (layer.layer != Layer::Color) continue;
    auto color = decodeColor(layer.codec, layer.bytes, tile.size);
    if (!color) return tl::unexpected(color.error());
    exact = std::exchange(tile.color, std::move(*color));
  }
  Coded coded{std::move(*write), halved(tile, spare_halves_.take())};
  tile.color = std::move(exact);
  encode_s += encoded - start;
  parents_s += threadCpu_s() - encoded;
  return coded;
}

Result<void> PlanarMap::codeTiles() {
  std::vector<std::optional<Coded>> coded(waiting_.size());
  auto done = workers_.forEach(waiting_.size(), [&](std::size_t i) -> Result<void> {
    Tile& tile = drawn_.at(waiting_[i]).tile;
    // A tile of which frames only graze a corner may be empty; it is not stored.
    if (tile.empty()) return {};
    double encode_s = 0, parents_s = 0;
    auto one = code(tile, encode_s, parents_s);
    if (!one) return tl::unexpected(one.error());
    coded[i] = std::move(*one);
    const std::scoped_lock lock(statistics_mutex_);
    statistics_.encode_s += encode_s;
    statistics_.parents_s += parents_s;
    return {};
  });
  if (!done) return done;
  for (std::size_t i = 0; i < waiting_.size(); ++i) {
    drawn_.at(waiting_[i]).waits = false;
    if (!coded[i]) continue;
    ++statistics_.coded;
    scheduler_.markParentOf(waiting_[i]);
    keepHalf(std::move(coded[i]->half), true);
    batch_.tiles.push_back(std::move(coded[i]->write));
  }
  waiting_.clear();
  return {};
}

Result<std::shared_ptr<const Tile>> PlanarMap::half(const geo::TileKey& key) {
  if (const auto found = halves_.find(key); found != halves_.end()) {
    halves_order_.splice(halves_order_.end(), halves_order_, found->second.place);
    return found->second.tile;
  }
  auto stored = readTile(reader_, key, only(Layer::Color) | only(Layer::Quality));
  if (!stored) {
    if (stored.error().code == ErrorCode::NotFound) return std::shared_ptr<const Tile>();
    return tl::unexpected(stored.error());
  }
  stored->confidence = stored->views = stored->angle = {};  // none here, which the store holds as zeros
  return keepHalf(halved(*stored, spare_halves_.take()), false);
}

// `waits`: its tile is part of the batch.
std::shared_ptr<const Tile> PlanarMap::keepHalf(Tile&& half, bool waits) {
  const auto [at, fresh] = halves_.try_emplace(half.key);
  if (fresh)
    at->second.place = halves_order_.insert(halves_order_.end(), half.key);
  else
    halves_order_.splice(halves_order_.end(), halves_order_, at->second.place);
  at->second.waits = waits;
  const std::shared_ptr<const Tile> kept(new Tile(std::move(half)), [this](Tile* gone) {
    const std::unique_ptr<Tile> owner(gone);
    spare_halves_.give(std::move(*gone));
  });
  at->second.tile = kept;
  // Only what is on its way to the store may leave memory.
  for (auto key = halves_order_.begin();
       key != halves_order_.end() && halves_.size() * halfBytes(drawnBytes()) > options_.tile_bytes / 4;) {
    const auto old = halves_.find(*key++);
    if (old->second.waits || old == at) continue;
    gone_.insert(old->first);
    halves_order_.erase(old->second.place);
    halves_.erase(old);
  }
  return kept;
}

Result<void> PlanarMap::makeParents(std::span<const TileJob> jobs) {
  // Children that left memory are read from the store: they must be there.
  std::vector<std::array<std::shared_ptr<const Tile>, 4>> children(jobs.size());
  const bool top = jobs.front().kind == TileJob::Kind::Top;
  const double reading = threadCpu_s();
  bool flushed = false;
  for (std::size_t j = 0; j < jobs.size(); ++j)
    for (int i = 0; i < 4; ++i) {
      const geo::TileKey key = top ? scheduler_.layout().top()->child(i) : geo::childOf(jobs[j].key, i);
      if (!flushed && gone_.contains(key) && !halves_.contains(key)) {
        const auto start = std::chrono::steady_clock::now();
        if (!writer_.flush(std::chrono::seconds(60)))
          return fail(ErrorCode::Io, "the disk does not take the map: " + writer_.status().reason);
        statistics_.commit_s +=
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        flushed = true;
        gone_.clear();
      }
      auto tile = half(key);
      if (!tile) return tl::unexpected(tile.error());
      children[j][static_cast<std::size_t>(i)] = std::move(*tile);
    }
  statistics_.parents_s += threadCpu_s() - reading;
  std::vector<std::optional<Coded>> coded(jobs.size());
  auto done = workers_.forEach(jobs.size(), [&](std::size_t j) -> Result<void> {
    const double start = threadCpu_s();
    std::array<const Tile*, 4> held{};
    for (std::size_t i = 0; i < 4; ++i) held[i] = children[j][i].get();
    Tile tile = joinHalves(jobs[j].key, held, spare_joined_.take());
    if (!tile.empty()) {
      double encode_s = 0, parents_s = 0;
      auto one = code(tile, encode_s, parents_s);
      if (!one) return tl::unexpected(one.error());
      one->write.top = top;
      coded[j] = std::move(*one);
    }
    spare_joined_.give(std::move(tile));
    const std::scoped_lock lock(statistics_mutex_);
    statistics_.parents_s += threadCpu_s() - start;
    return {};
  });
  if (!done) return done;
  for (std::size_t j = 0; j < jobs.size(); ++j) {
    scheduler_.done(jobs[j], coded[j].has_value(), now_ns());
    if (!coded[j]) continue;
    ++statistics_.parents;
    if (!top) keepHalf(std::move(coded[j]->half), true);
    batch_.tiles.push_back(std::move(coded[j]->write));
  }
  return {};
}

Result<void> PlanarMap::submit() {
  const auto start = std::chrono::steady_clock::now();
  if (gone_.size() > kMostGone && !writer_.flush(std::chrono::seconds(60)))
    return fail(ErrorCode::Io, "the disk does not take the map: " + writer_.status().reason);
  // What left memory came with earlier batches.
  if (writer_.status().waiting_batches == 0) gone_.clear();
  for (;;) {
    const auto submitted = writer_.submit(std::move(batch_));
    if (submitted) break;
    if (submitted.error().code != ErrorCode::Unavailable) return tl::unexpected(submitted.error());
    if (!writer_.flush(std::chrono::seconds(60)))
      return fail(ErrorCode::Io, "the disk does not take the map: " + writer_.status().reason);
  }
  batch_ = {};
  statistics_.commit_s += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  for (auto& [key, half] : halves_) half.waits = false;
  return {};
}

Result<void> PlanarMap::finish() {
  while (!arriving_.empty())
    if (auto ok = takeNext(); !ok) return ok;
  if (auto ok = finishBatch(); !ok) return ok;
  const auto start = std::chrono::steady_clock::now();
  if (!writer_.flush(std::chrono::seconds(60)))
    return fail(ErrorCode::Io, "the disk does not take the map: " + writer_.status().reason);
  statistics_.commit_s += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const StoreWriter::Status written = writer_.status();
  statistics_.commits = written.commits;
  statistics_.bytes = written.layer_bytes;
  return {};
}

}  // namespace overfly::tiling
