#include "daemon/overflyd/pipeline.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <time.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

#include "capture/geo/geodetic.h"
#include "capture/replay/replay_source.h"
#include "daemon/overflyd/options.h"
#include "tiling/clipmap/parent.h"
#include "tiling/store/make_frame_record.h"
#include "tiling/store/tile_codec.h"

namespace overfly::daemon {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kFramesInMemory = 16;  // of those that wait; the others are read again from disk
constexpr std::size_t kTilesToEncode = 64;   // batches; the mapping thread waits beyond
constexpr std::size_t kRecentTiles = 320;
constexpr std::size_t kSettlingFrames = 3;  // with pose, before the map's place is settled
constexpr std::size_t kSettlingLimit = 12;  // after so many without an agreement the pipeline says so

std::int64_t now_ns() {
  timespec t{};
  clock_gettime(CLOCK_BOOTTIME, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

tiling::PlaneBox boxOf(const std::array<Eigen::Vector2d, 4>& polygon) {
  tiling::PlaneBox box{polygon[0].x(), polygon[0].y(), polygon[0].x(), polygon[0].y()};
  for (const Eigen::Vector2d& corner : polygon) {
    box.west = std::min(box.west, corner.x());
    box.north = std::min(box.north, corner.y());
    box.east = std::max(box.east, corner.x());
    box.south = std::max(box.south, corner.y());
  }
  return box;
}

nlohmann::json asJson(const tiling::MapGround& ground) {
  return {{"base_zoom", ground.base_zoom},       {"gsd_m", ground.gsd_m},
          {"texel_m", ground.texel_m},           {"height_m", ground.height_m},
          {"min_height_m", ground.min_height_m}, {"max_height_m", ground.max_height_m},
          {"anchor_px", ground.anchor_px}};
}

Result<tiling::MapGround> groundFrom(const tiling::MapMeta& meta) {
  auto lattice = geo::TileLattice::parse(meta.lattice);
  if (!lattice) return tl::unexpected(lattice.error());
  tiling::MapGround ground;
  ground.lattice = *lattice;
  const nlohmann::json extra = nlohmann::json::parse(meta.extra, nullptr, false);
  if (extra.is_discarded() || !extra.contains("ground"))
    return fail(ErrorCode::Corrupt,
                "the map does not say where its ground is: it was not made by this daemon");
  const nlohmann::json& g = extra["ground"];
  ground.base_zoom = g.value("base_zoom", 0);
  ground.gsd_m = g.value("gsd_m", 0.0);
  ground.texel_m = g.value("texel_m", 0.0);
  ground.height_m = g.value("height_m", 0.0);
  ground.min_height_m = g.value("min_height_m", 0.0);
  ground.max_height_m = g.value("max_height_m", 0.0);
  ground.anchor_px = g.value("anchor_px", 0.5);
  return ground;
}

// Angle between the view and straight down, radians.
double tiltOf(const capture::Pose& pose) {
  const geo::Geodetic place = geo::geodeticFromEcef(pose.position_in_ecef);
  const Eigen::Vector3d view = pose.ecef_from_camera * Eigen::Vector3d::UnitZ();
  return std::acos(std::clamp(-view.dot(geo::upInEcef(place.lat, place.lon)), -1.0, 1.0));
}

}  // namespace

Pipeline::Pipeline(const config::Settings& settings, std::unique_ptr<capture::FrameSource> source,
                   std::filesystem::path folder)
    : settings_(settings),
      source_(std::move(source)),
      live_(dynamic_cast<capture::LiveSource*>(source_.get())),
      folder_(std::move(folder)) {
  status_.source = source_->describe();
}

Pipeline::~Pipeline() { stop(); }

Result<void> Pipeline::start() {
  std::error_code code;
  std::filesystem::create_directories(folder_, code);
  if (code)
    return fail(ErrorCode::Io, fmt::format("{} cannot be made: {}", folder_.string(), code.message()));
  auto recorded = RecordedFrames::open(folder_);
  if (!recorded) return tl::unexpected(recorded.error());
  recorded_ = std::move(*recorded);
  // What earlier runs recorded is mapped first.
  for (std::uint64_t id = 0; id < recorded_->earlier(); ++id) frames_.push_back({id, nullptr, now_ns()});
  status_.seen = recorded_->earlier();
  if (live_ != nullptr && settings_.record.raw_inputs)
    live_->onRaw([this](const capture::RawInput& input) { recorded_->record(input); });
  threads_.emplace_back([this](const std::stop_token& stop) { encode(stop); });
  threads_.emplace_back([this](const std::stop_token& stop) { map(stop); });
  threads_.emplace_back([this](const std::stop_token& stop) { capture(stop); });
  return {};
}

void Pipeline::stop() {
  if (threads_.empty()) return;
  source_->stop();
  // Capture first, then mapping, then encoding what mapping still handed on.
  for (auto thread = threads_.rbegin(); thread != threads_.rend(); ++thread) {
    thread->request_stop();
    wake_.notify_all();
    thread->join();
  }
  threads_.clear();
  if (live_ != nullptr) live_->onRaw({});
  recorded_->close();
  reader_.reset();
  writer_.reset();
}

PipelineStatus Pipeline::status() const {
  const std::scoped_lock lock(mutex_);
  PipelineStatus status = status_;
  status.waiting_frames = frames_.size();
  if (!frames_.empty())
    status.lag_s = std::max(status.lag_s, static_cast<double>(now_ns() - frames_.front().arrived_ns) / 1e9);
  return status;
}

void Pipeline::interest(const geo::TileKey& key) {
  const std::scoped_lock lock(mutex_);
  if (interests_.size() < 256) interests_.push_back(key);
}

void Pipeline::giveUp(const Error& error) {
  spdlog::error("{}", error.message);
  const std::scoped_lock lock(mutex_);
  status_.failed = true;
  status_.error = error.message;
}

// --- capture -----------------------------------------------------------------------------------------------

void Pipeline::capture(const std::stop_token& stop) {
  std::string last_problem;
  while (!stop.stop_requested()) {
    if (auto opened = source_->open(); !opened) {
      if (opened.error().code == ErrorCode::BadSettings || opened.error().code == ErrorCode::NotFound)
        return giveUp(opened.error());
      if (opened.error().message != last_problem)
        spdlog::warn("{}: {}", source_->describe(), opened.error().message);
      last_problem = opened.error().message;
      std::unique_lock lock(mutex_);
      wake_.wait_for(lock, stop, std::chrono::duration<double>(settings_.source.retry_s),
                     [] { return false; });
      continue;
    }
    flight_info_.source = source_->describe();
    flight_info_.made_by = "overflyd";
    if (const auto* replay = dynamic_cast<const capture::ReplaySource*>(source_.get());
        replay != nullptr && replay->flight()) {
      const std::string made_by = flight_info_.made_by;
      flight_info_ = replay->flight()->info();
      flight_info_.made_by = made_by;
    }
    {
      const std::scoped_lock lock(mutex_);
      status_.source_open = true;
    }
    while (!stop.stop_requested()) {
      auto frame = source_->next(500ms);
      ++progress_;
      takeLatePoses();
      if (!frame) {
        if (frame.error().code == ErrorCode::Unavailable) continue;
        spdlog::warn("frame: {}", frame.error().message);
        const std::scoped_lock lock(mutex_);
        ++status_.refused["unreadable"];
        continue;
      }
      if (*frame == nullptr) break;
      flight_info_.datum = (*frame)->datum;
      auto id = recorded_->record(**frame, flight_info_);
      const std::scoped_lock lock(mutex_);
      ++status_.seen;
      if (!id) {
        spdlog::error("recording {}: {}", (*frame)->name, id.error().message);
        ++status_.refused["not recorded"];
        continue;
      }
      frames_.push_back({*id, *frame, now_ns()});
      if (frames_.size() > kFramesInMemory) frames_[frames_.size() - 1 - kFramesInMemory].frame = nullptr;
      wake_.notify_all();
    }
    source_->close();
    const std::scoped_lock lock(mutex_);
    status_.source_open = false;
    status_.source_ended = true;
    wake_.notify_all();
    return;
  }
}

void Pipeline::takeLatePoses() {
  for (const capture::LatePose& late : source_->takeLatePoses()) {
    auto id = recorded_->record(late);
    if (!id) {
      spdlog::error("a pose that came late: {}", id.error().message);
      continue;
    }
    const std::scoped_lock lock(mutex_);
    ++status_.late_poses;
    frames_.push_back({*id, nullptr, now_ns()});
    wake_.notify_all();
  }
}

// --- mapping -----------------------------------------------------------------------------------------------

Result<void> Pipeline::settle(tiling::Mapper& mapper) {
  tiling::MapGround ground;
  if (std::filesystem::exists(mapFile())) {
    auto store = tiling::MapStore::open(mapFile());
    if (!store) return tl::unexpected(store.error());
    auto known = groundFrom(store->meta());
    if (!known) return tl::unexpected(known.error());
    ground = *known;
    writer_ = std::make_unique<tiling::StoreWriter>(std::move(*store), tiling::StoreWriter::Options{});
  } else {
    std::vector<tiling::Thumbnail> thumbnails;
    std::vector<capture::CameraModel> cameras;
    capture::VerticalDatum datum = capture::VerticalDatum::Unknown;
    for (const Waiting& waiting : unsettled_) {
      auto thumbnail = mapper.thumbnailOf(waiting.id, waiting.frame);
      if (!thumbnail) return tl::unexpected(thumbnail.error());
      thumbnails.push_back(std::move(*thumbnail));
      cameras.push_back(waiting.frame->camera);
      datum = waiting.frame->datum;
    }
    std::optional<double> gsd;
    if (settings_.map.gsd_m > 0) gsd = settings_.map.gsd_m;
    auto lattice = geo::TileLattice::parse(settings_.map.lattice);
    if (!lattice) return fail(ErrorCode::BadSettings, "map.lattice: " + lattice.error().message);
    const auto settleOn = [&](std::optional<double> height_m) {
      return tiling::Mapper::settleGround(thumbnails, cameras, *lattice, settings_.map.tile_size, height_m,
                                          gsd);
    };
    auto settled = settleOn(std::nullopt);
    // What the flight says of the ground (take-off, say) is taken when the images do not contradict it: they
    // may show a wood's canopy.
    if (const auto said = flight_info_.ground_height_m) {
      const auto on_said = settleOn(said);
      const bool agree =
          settled && on_said &&
          std::abs(on_said->height_m - settled->height_m) < 0.35 * on_said->gsd_m * cameras.front().fx;
      if (agree || (!settled && unsettled_.size() >= kSettlingLimit)) settled = on_said;
    }
    if (!settled) return tl::unexpected(settled.error());
    ground = *settled;
    tiling::MapMeta meta;
    meta.name = folder_.filename().string();
    meta.lattice = ground.lattice.text();
    meta.datum = datum;
    meta.tile_size = settings_.map.tile_size;
    meta.base_zoom = ground.base_zoom;
    meta.elevation_step_m = settings_.store.elevation_step_m;
    meta.created_utc_ns = unsettled_.front().frame->time_ns + unsettled_.front().frame->utc_offset_ns;
    meta.extra = nlohmann::json{{"ground", asJson(ground)}}.dump();
    auto store = tiling::MapStore::create(mapFile(), meta);
    if (!store) return tl::unexpected(store.error());
    writer_ = std::make_unique<tiling::StoreWriter>(std::move(*store), tiling::StoreWriter::Options{});
  }
  auto reader = writer_->reader();
  if (!reader) return tl::unexpected(reader.error());
  reader_.emplace(std::move(*reader));
  writer_->addListener([this](std::uint64_t, const std::vector<geo::TileKey>& tiles) {
    ++progress_;
    {
      const std::scoped_lock lock(mutex_);
      status_.tiles += tiles.size();
    }
    if (on_commit_) on_commit_();
  });
  mapper.setGround(ground);
  scheduler_ = std::make_unique<tiling::Scheduler>(mapper.cellZoom(), schedulerOptions(settings_));
  spdlog::info("map at zoom {} ({:.1f} cm a texel), ground near {:.1f} m, swept between {:.0f} and {:.0f} m",
               ground.base_zoom, 100 * ground.texel_m, ground.height_m, ground.min_height_m,
               ground.max_height_m);
  const std::scoped_lock lock(mutex_);
  status_.settled = true;
  return {};
}

void Pipeline::refuse(std::uint64_t id, const std::string& reason) {
  spdlog::warn("frame {} is recorded but not mapped: {}", id, reason);
  const std::scoped_lock lock(mutex_);
  ++status_.refused[reason];
}

Result<void> Pipeline::takeFrame(tiling::Mapper& mapper, const Waiting& waiting) {
  if (tiltOf(*waiting.frame->pose) > geo::radians(settings_.pose.max_tilt_deg)) {
    refuse(waiting.id, "tilted beyond pose.max_tilt_deg");
    return {};
  }
  auto added =
      mapper.addFrame(waiting.id, waiting.frame, [this, id = waiting.id] { return recorded_->load(id); });
  if (!added) {
    if (added.error().code == ErrorCode::Unavailable) return tl::unexpected(added.error());
    refuse(waiting.id, added.error().message);
    return {};
  }
  const tiling::IndexedFrame& record = *mapper.index().find(waiting.id);
  if (record.near_vertical) scheduler_->cover(boxOf(record.footprint));
  const std::int64_t now = now_ns();
  std::vector<tiling::Tile> first_sight;
  for (const geo::TileKey& cell : *added) {
    scheduler_->mark(cell, 1.0, now);
    cell_since_ns_.try_emplace(cell, waiting.arrived_ns);
    // A cell that shows nothing yet gets the plain projection at once.
    if (!seen_cells_.insert(cell).second) continue;
    auto tiles = mapper.provisionalCell(cell);
    if (!tiles) return tl::unexpected(tiles.error());
    for (tiling::Tile& tile : *tiles) first_sight.push_back(std::move(tile));
  }
  if (!first_sight.empty()) publish(std::move(first_sight));
  tiling::FrameRecord stored = tiling::makeFrameRecord(waiting.id, *waiting.frame);
  stored.state = tiling::FrameState::Mapped;
  if (record.near_vertical) stored.box = boxOf(record.footprint);
  if (auto footprint = geo::footprint(record.camera, record.pose, record.ground_height_m))
    stored.footprint = *footprint;
  const std::scoped_lock lock(mutex_);
  encoding_.push_back({{}, {std::move(stored)}});
  wake_.notify_all();
  ++status_.mapped;
  status_.first_sight_s = static_cast<double>(now_ns() - waiting.arrived_ns) / 1e9;
  status_.mapper = mapper.statistics();
  return {};
}

void Pipeline::publish(std::vector<tiling::Tile> tiles) {
  for (const tiling::Tile& tile : tiles) {
    if (recent_.insert_or_assign(tile.key, std::make_shared<const tiling::Tile>(tile)).second)
      recent_order_.push_back(tile.key);
    while (recent_order_.size() > kRecentTiles) {
      recent_.erase(recent_order_.front());
      recent_order_.pop_front();
    }
  }
  std::unique_lock lock(mutex_);
  wake_.wait(lock, [&] { return encoding_.size() < kTilesToEncode; });
  encoding_.push_back({std::move(tiles), {}});
  wake_.notify_all();
}

Result<void> Pipeline::makeParentOf(const geo::TileKey& key) {
  std::array<std::shared_ptr<const tiling::Tile>, 4> held;
  std::array<const tiling::Tile*, 4> children{};
  for (int i = 0; i < 4; ++i) {
    const geo::TileKey child = geo::childOf(key, i);
    const auto n = static_cast<std::size_t>(i);
    if (const auto found = recent_.find(child); found != recent_.end()) {
      held[n] = found->second;
    } else if (auto stored = tiling::readTile(*reader_, child)) {
      held[n] = std::make_shared<const tiling::Tile>(std::move(*stored));
    } else if (stored.error().code != ErrorCode::NotFound) {
      return tl::unexpected(stored.error());
    }
    children[n] = held[n].get();
  }
  std::vector<tiling::Tile> made;
  made.push_back(tiling::makeParent(key, children));
  if (!made.front().empty()) publish(std::move(made));
  return {};
}

Result<void> Pipeline::work(tiling::Mapper& mapper, const tiling::TileJob& job) {
  if (job.kind == tiling::TileJob::Kind::Top) return {};  // for the preview alone
  if (job.kind == tiling::TileJob::Kind::FromChildren) return makeParentOf(job.key);
  auto changed = mapper.sweepCell(job.key);
  if (!changed) return tl::unexpected(changed.error());
  auto tiles = mapper.finishCell(job.key);
  if (!tiles) return tl::unexpected(tiles.error());
  std::set<geo::TileKey> parents;
  for (const tiling::Tile& tile : *tiles) parents.insert(geo::parentOf(tile.key));
  publish(std::move(*tiles));
  // Tiles between the cell's own zoom and level 0 lie wholly within the cell.
  for (int zoom = mapper.ground().base_zoom - 1; zoom >= mapper.cellZoom(); --zoom) {
    std::set<geo::TileKey> next;
    for (const geo::TileKey& key : parents) {
      if (auto ok = makeParentOf(key); !ok) return ok;
      next.insert(geo::parentOf(key));
    }
    parents = std::move(next);
  }
  if (*changed)
    for (const geo::TileKey& neighbour : tiling::Mapper::neighboursOf(job.key))
      if (neighbour != job.key && seen_cells_.contains(neighbour)) scheduler_->mark(neighbour, 0.1, now_ns());
  return {};
}

void Pipeline::map(const std::stop_token& stop) {
  auto context = gl::Context::create();
  if (!context) return giveUp(context.error());
  auto created = tiling::Mapper::create(*context, mapperOptions(settings_));
  if (!created) return giveUp(created.error());
  tiling::Mapper& mapper = **created;
  std::optional<Error> unsettled_reason;
  bool balanced = true;
  while (!stop.stop_requested()) {
    std::optional<Waiting> waiting;
    bool ended = false;
    {
      std::unique_lock lock(mutex_);
      if (scheduler_) {
        for (const geo::TileKey& key : interests_) scheduler_->requested(key, now_ns());
      }
      interests_.clear();
      if (!frames_.empty()) {
        waiting = std::move(frames_.front());
        frames_.pop_front();
      }
      ended = status_.source_ended && frames_.empty() && !waiting;
    }
    if (waiting) {
      ++progress_;
      if (waiting->frame == nullptr) {
        auto loaded = recorded_->load(waiting->id);
        if (!loaded) {
          refuse(waiting->id, loaded.error().message);
          continue;
        }
        waiting->frame = *loaded;
      }
      if (!waiting->frame->pose) {
        const std::string& reason = waiting->frame->no_pose_reason;
        refuse(waiting->id, reason.empty() ? "no pose" : reason);
        continue;
      }
      if (!scheduler_) {
        unsettled_.push_back(*waiting);
        if (unsettled_.size() < kSettlingFrames && !std::filesystem::exists(mapFile())) continue;
        if (auto ok = settle(mapper); !ok) {
          if (ok.error().code != ErrorCode::Unavailable) return giveUp(ok.error());
          unsettled_reason = ok.error();
          if (unsettled_.size() > 4 * kSettlingLimit) unsettled_.erase(unsettled_.begin());
          continue;
        }
        for (const Waiting& held : unsettled_)
          if (auto ok = takeFrame(mapper, held); !ok) return giveUp(ok.error());
        unsettled_.clear();
        continue;
      }
      if (auto ok = takeFrame(mapper, *waiting); !ok) return giveUp(ok.error());
      balanced = false;
      continue;
    }
    if (ended && scheduler_ && !balanced) {
      // After the last frame: exposures of the whole flight, and nothing waits for more frames.
      for (const geo::TileKey& cell : mapper.balanceExposure()) scheduler_->markDue(cell, now_ns());
      for (const geo::TileKey& cell : scheduler_->unfinishedTiles()) scheduler_->markDue(cell, now_ns());
      balanced = true;
    }
    auto job = scheduler_ ? scheduler_->next(now_ns()) : std::nullopt;
    if (!job) {
      std::unique_lock lock(mutex_);
      status_.idle = frames_.empty() && (!scheduler_ || scheduler_->waitingTiles() == 0) && encoding_.empty();
      status_.waiting_cells = scheduler_ ? scheduler_->waitingTiles() : 0;
      if (status_.idle) status_.lag_s = 0;
      if (ended && !scheduler_ && unsettled_reason && !status_.failed) {
        status_.failed = true;
        status_.error = unsettled_reason->message;
      }
      wake_.wait_for(lock, stop, 50ms, [&] { return !frames_.empty(); });
      continue;
    }
    ++progress_;
    if (auto ok = work(mapper, *job); ok) {
      scheduler_->done(*job, true, now_ns());
      cell_since_ns_.erase(job->key);
    } else {
      if (ok.error().code == ErrorCode::Unavailable) return giveUp(ok.error());
      spdlog::error("tile {}/{}/{}: {}", job->key.zoom, job->key.x, job->key.y, ok.error().message);
      scheduler_->failed(*job, now_ns());
    }
    const std::scoped_lock lock(mutex_);
    status_.idle = false;
    status_.waiting_cells = scheduler_->waitingTiles();
    status_.mapper = mapper.statistics();
    std::int64_t oldest = now_ns();
    for (const auto& [cell, since] : cell_since_ns_) oldest = std::min(oldest, since);
    status_.lag_s = static_cast<double>(now_ns() - oldest) / 1e9;
  }
}

// --- encoding ----------------------------------------------------------------------------------------------

void Pipeline::encode(const std::stop_token& stop) {
  std::optional<tiling::EncodeOptions> options;
  std::optional<std::chrono::steady_clock::time_point> until;
  for (;;) {
    Encoding work;
    {
      std::unique_lock lock(mutex_);
      wake_.wait(lock, stop, [&] { return !encoding_.empty(); });
      if (encoding_.empty()) break;
      // What cannot be encoded in time is made again when the mission is taken up.
      if (stop.stop_requested() && !until) until = std::chrono::steady_clock::now() + 700ms;
      if (until && std::chrono::steady_clock::now() > *until) break;
      work = std::move(encoding_.front());
      encoding_.pop_front();
      wake_.notify_all();
    }
    if (!options) {
      options = tiling::encodeOptions(writer_->meta());
      options->color.quality = settings_.store.color_quality;
    }
    tiling::Batch batch;
    batch.frames = std::move(work.frames);
    for (const tiling::Tile& tile : work.tiles) {
      auto encoded = tiling::encodeTile(tile, *options);
      if (!encoded) {
        spdlog::error("tile {}/{}/{}: {}", tile.key.zoom, tile.key.x, tile.key.y, encoded.error().message);
        continue;
      }
      batch.tiles.push_back(std::move(*encoded));
    }
    ++progress_;
    for (;;) {
      auto submitted = writer_->submit(std::move(batch));
      const auto store = writer_->status();
      {
        const std::scoped_lock lock(mutex_);
        status_.store_problem = store.degraded ? store.reason : "";
      }
      if (submitted || stop.stop_requested()) break;
      std::this_thread::sleep_for(100ms);
    }
  }
  if (writer_) (void)writer_->flush(1000ms);
}

}  // namespace overfly::daemon
