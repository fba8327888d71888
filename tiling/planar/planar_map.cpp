#include "tiling/planar/planar_map.h"

#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <set>
#include <utility>

#include "tiling/clipmap/parent.h"

namespace overfly::tiling {
namespace {

// Coded tiles that wait for the disk: little, so that a slow disk slows the map instead of filling memory.
constexpr std::size_t kQueueBytes = 2u << 20;

double threadCpu_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// Calls body(i) for 0 <= i < count on so many threads, this one included; the first error ends it.
template <typename Body>
Result<void> inParallel(std::size_t count, int threads, const Body& body) {
  std::atomic<std::size_t> next = 0;
  const auto run = [&]() -> Result<void> {
    for (std::size_t i; (i = next++) < count;)
      if (Result<void> done = body(i); !done) {
        next = count;
        return done;
      }
    return {};
  };
  std::vector<std::future<Result<void>>> others;
  for (std::size_t k = 1; k < std::min(static_cast<std::size_t>(std::max(1, threads)), count); ++k)
    others.push_back(std::async(std::launch::async, run));
  Result<void> result = run();
  for (auto& other : others)
    if (Result<void> done = other.get(); !done && result) result = std::move(done);
  return result;
}

PlaneBox boxOf(const std::array<Eigen::Vector2d, 4>& polygon) {
  PlaneBox box{polygon[0].x(), polygon[0].y(), polygon[0].x(), polygon[0].y()};
  for (const Eigen::Vector2d& corner : polygon)
    box = {std::min(box.west, corner.x()), std::min(box.north, corner.y()), std::max(box.east, corner.x()),
           std::max(box.south, corner.y())};
  return box;
}

// A tile as its parents are to see it: colours as readers will decode them, so that a parent is a function of
// what is stored, whether its children come from memory or from the store; and no more than they need.
Result<void> asStored(Tile& tile, const TileWrite& write) {
  tile.source = {};
  for (const EncodedLayer& layer : write.layers) {
    if (layer.layer != Layer::Color) continue;
    auto color = decodeColor(layer.codec, layer.bytes, tile.size);
    if (!color) return tl::unexpected(color.error());
    tile.color = std::move(*color);
  }
  return {};
}

std::size_t bytesOf(const Tile& tile) { return tile.color.size() + tile.kind.size() + tile.gsd.size(); }

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
      images_(options.image_bytes) {}

PlanarMap::~PlanarMap() = default;

Result<PlanarImagePtr> PlanarMap::decode(const capture::Frame& frame, double gsd_m) {
  const double start = threadCpu_s();
  auto image = decodeForPlane(frame, gsd_m, texel_m_);
  const std::scoped_lock lock(statistics_mutex_);
  statistics_.decode_s += threadCpu_s() - start;
  ++statistics_.images_loaded;
  if (!image) return tl::unexpected(image.error());
  return std::make_shared<const PlanarImage>(std::move(*image));
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
  arriving_.push_back(
      {id, std::async(std::launch::async, [this, gsd_m, frame] { return decode(*frame, gsd_m); })});
  while (arriving_.size() > static_cast<std::size_t>(std::max(0, options_.ahead)))
    if (auto ok = takeNext(); !ok) return ok;
  return {};
}

// The oldest frame that has arrived: its tiles are marked and made.
Result<void> PlanarMap::takeNext() {
  Arriving arriving = std::move(arriving_.front());
  arriving_.pop_front();
  auto image = arriving.image.get();
  if (!image) {
    index_.remove(arriving.id);
    sources_.erase(arriving.id);
    return tl::unexpected(image.error());
  }
  const std::size_t bytes = (*image)->bytes();
  images_.insert(arriving.id, std::move(*image), bytes);
  const IndexedFrame& record = *index_.find(arriving.id);
  scheduler_.cover(boxOf(record.footprint));
  if (auto made = makeTiles(arriving.id, FrameIndex::tilesUnder(record, base_zoom_)); !made) return made;
  const bool full = batch_.tiles.size() >= static_cast<std::size_t>(std::max(1, options_.batch_tiles));
  return full || batch_bytes_ > options_.tile_bytes ? finishBatch() : Result<void>{};
}

// The parents of what the batch holds, level by level; then all of it is one transaction.
Result<void> PlanarMap::finishBatch() {
  for (;;) {
    std::vector<TileJob> jobs;
    while (auto job = scheduler_.next(now_ns())) jobs.push_back(*job);
    if (jobs.empty()) break;
    if (auto made = makeParents(jobs); !made) return made;
  }
  return batch_.tiles.empty() ? Result<void>{} : submit();
}

Result<void> PlanarMap::makeTiles(std::uint64_t id, std::span<const geo::TileKey> keys) {
  std::vector<std::optional<PlanarPlan>> planned(keys.size());
  auto done = inParallel(keys.size(), options_.threads, [&](std::size_t i) -> Result<void> {
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
  for (auto& plan : planned) {
    const std::vector<std::uint64_t>& frames = plan->frames();
    if (std::binary_search(frames.begin(), frames.end(), id))
      plans.push_back(std::move(*plan));
    else
      ++statistics_.unchanged;
  }
  const auto images = imagesOf(plans);
  if (!images) return tl::unexpected(images.error());

  std::vector<Tile> tiles(plans.size());
  std::vector<TileWrite> writes(plans.size());
  done = inParallel(plans.size(), options_.threads, [&](std::size_t i) -> Result<void> {
    const double start = threadCpu_s();
    tiles[i] = plans[i].render((*images)[i]);
    const double rendered = threadCpu_s();
    auto write = encodeTile(tiles[i], options_.encoding);
    if (!write) return tl::unexpected(write.error());
    writes[i] = std::move(*write);
    const double encoded = threadCpu_s();
    auto ok = asStored(tiles[i], writes[i]);
    const std::scoped_lock lock(statistics_mutex_);
    statistics_.project_s += rendered - start;
    statistics_.encode_s += encoded - rendered;
    statistics_.parents_s += threadCpu_s() - encoded;
    return ok;
  });
  if (!done) return done;
  for (std::size_t i = 0; i < plans.size(); ++i) {
    // A tile of which the frame only grazes a corner may be empty; it is not stored.
    if (tiles[i].empty()) continue;
    ++statistics_.tiles;
    scheduler_.markParentOf(tiles[i].key);
    keep(std::move(tiles[i]));
    batch_.tiles.push_back(std::move(writes[i]));
  }
  return {};
}

// The pictures that each plan needs; those that the cache has lost are loaded again.
Result<std::vector<std::vector<PlanarImagePtr>>> PlanarMap::imagesOf(std::span<const PlanarPlan> plans) {
  std::map<std::uint64_t, PlanarImagePtr> held;
  for (const PlanarPlan& plan : plans)
    for (const std::uint64_t id : plan.frames()) held.try_emplace(id, images_.find(id));
  std::vector<std::pair<const std::uint64_t, PlanarImagePtr>*> missing;
  for (auto& entry : held)
    if (!entry.second) missing.push_back(&entry);
  auto done = inParallel(missing.size(), options_.threads, [&](std::size_t i) -> Result<void> {
    const Source& source = sources_.at(missing[i]->first);
    auto frame = source.load();
    if (!frame) return tl::unexpected(frame.error());
    auto image = decode(**frame, source.gsd_m);
    if (!image) return tl::unexpected(image.error());
    missing[i]->second = std::move(*image);
    return {};
  });
  if (!done) return tl::unexpected(done.error());
  for (const auto* entry : missing) images_.insert(entry->first, entry->second, entry->second->bytes());
  std::vector<std::vector<PlanarImagePtr>> images;
  for (const PlanarPlan& plan : plans) {
    auto& list = images.emplace_back();
    for (const std::uint64_t id : plan.frames()) list.push_back(held.at(id));
  }
  return images;
}

Result<std::shared_ptr<const Tile>> PlanarMap::child(const geo::TileKey& key) {
  if (const auto found = recent_.find(key); found != recent_.end()) return found->second;
  auto stored = readTile(reader_, key, only(Layer::Color) | only(Layer::Quality));
  if (stored) {
    stored->source = {};
    stored->confidence = {};
    stored->views = {};
    return std::make_shared<const Tile>(std::move(*stored));
  }
  if (stored.error().code == ErrorCode::NotFound) return std::shared_ptr<const Tile>();
  return tl::unexpected(stored.error());
}

Result<void> PlanarMap::makeParents(std::span<const TileJob> jobs) {
  // Children that left memory are read from the store: everything older must be there.
  std::vector<std::array<std::shared_ptr<const Tile>, 4>> children(jobs.size());
  const bool top = jobs.front().kind == TileJob::Kind::Top;
  const double reading = threadCpu_s();
  bool flushed = false;
  for (std::size_t j = 0; j < jobs.size(); ++j)
    for (int i = 0; i < 4; ++i) {
      const geo::TileKey key = top ? scheduler_.layout().top()->child(i) : geo::childOf(jobs[j].key, i);
      if (!flushed && !recent_.contains(key)) {
        const auto start = std::chrono::steady_clock::now();
        if (!writer_.flush(std::chrono::seconds(60)))
          return fail(ErrorCode::Io, "the disk does not take the map: " + writer_.status().reason);
        statistics_.commit_s +=
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        flushed = true;
      }
      auto tile = child(key);
      if (!tile) return tl::unexpected(tile.error());
      children[j][static_cast<std::size_t>(i)] = std::move(*tile);
    }
  statistics_.parents_s += threadCpu_s() - reading;
  std::vector<Tile> tiles(jobs.size());
  std::vector<TileWrite> writes(jobs.size());
  auto done = inParallel(jobs.size(), options_.threads, [&](std::size_t j) -> Result<void> {
    const double start = threadCpu_s();
    std::array<const Tile*, 4> held{};
    for (std::size_t i = 0; i < 4; ++i) held[i] = children[j][i].get();
    tiles[j] = makeParent(jobs[j].key, held);
    if (!tiles[j].empty()) {
      auto write = encodeTile(tiles[j], options_.encoding);
      if (!write) return tl::unexpected(write.error());
      write->top = top;
      writes[j] = std::move(*write);
      if (auto ok = asStored(tiles[j], writes[j]); !ok) return ok;
    }
    const std::scoped_lock lock(statistics_mutex_);
    statistics_.parents_s += threadCpu_s() - start;
    return {};
  });
  if (!done) return done;
  for (std::size_t j = 0; j < jobs.size(); ++j) {
    const bool empty = tiles[j].empty();
    scheduler_.done(jobs[j], !empty, now_ns());
    if (empty) continue;
    ++statistics_.parents;
    if (!top) keep(std::move(tiles[j]));
    batch_.tiles.push_back(std::move(writes[j]));
  }
  return {};
}

void PlanarMap::keep(Tile&& tile) {
  const geo::TileKey key = tile.key;
  auto& place = recent_[key];
  if (place)
    recent_bytes_ -= bytesOf(*place);
  else
    recent_order_.push_back(key);
  place = std::make_shared<const Tile>(std::move(tile));
  recent_bytes_ += bytesOf(*place);
  batch_bytes_ += bytesOf(*place);
}

Result<void> PlanarMap::submit() {
  // Only what is on its way to the store may leave memory.
  while (recent_bytes_ > options_.tile_bytes) {
    const auto oldest = recent_.find(recent_order_.front());
    recent_order_.pop_front();
    recent_bytes_ -= bytesOf(*oldest->second);
    recent_.erase(oldest);
  }
  const auto start = std::chrono::steady_clock::now();
  for (;;) {
    const auto submitted = writer_.submit(std::move(batch_));
    if (submitted) break;
    if (submitted.error().code != ErrorCode::Unavailable) return tl::unexpected(submitted.error());
    if (!writer_.flush(std::chrono::seconds(60)))
      return fail(ErrorCode::Io, "the disk does not take the map: " + writer_.status().reason);
  }
  batch_ = {};
  batch_bytes_ = 0;
  statistics_.commit_s += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
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
