#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

#include "capture/geo/geodetic.h"
#include "daemon/overflyd/boot_clock.h"
#include "daemon/overflyd/log.h"
#include "daemon/overflyd/options.h"
#include "daemon/overflyd/pipeline.h"
#include "tiling/clipmap/improvable.h"
#include "tiling/clipmap/parent.h"
#include "tiling/mapping/mapper_settings.h"
#include "tiling/store/make_frame_record.h"
#include "tiling/store/tile_cache.h"
#include "tiling/store/tile_codec.h"

// The mapping thread: from recorded frames to tiles that are ready to be encoded.
namespace overfly::daemon {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kTilesToEncode = 64;  // batches; the mapping thread waits beyond
constexpr std::size_t kSettlingFrames = 3;  // with pose, before the map's place is settled
constexpr std::size_t kSettlingLimit = 12;  // after so many without an agreement the pipeline says so
constexpr std::size_t kBalanceFrames = 10;  // that come before the exposures are equalised anew
constexpr double kStarved_s = 5;            // cells that have waited so long do not wait for frames
constexpr double kMostOwed_s = 2;           // of time in one go
constexpr std::int64_t kOldestShutter_ns = 60'000'000'000;

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

// When the light fell in: the frame's own time where it is one of this boot's clock, as a live camera's is;
// a recorded flight's times are those of another day, and its shutter is the moment at which it is played.
std::int64_t shutterOf(const capture::Frame& frame, std::int64_t arrived_ns) {
  const bool live = frame.time_ns <= arrived_ns && arrived_ns - frame.time_ns < kOldestShutter_ns;
  return live ? frame.time_ns : arrived_ns;
}

// Angle between the view and straight down, radians.
double tiltOf(const capture::Pose& pose) {
  const geo::Geodetic place = geo::geodeticFromEcef(pose.position_in_ecef);
  const Eigen::Vector3d view = pose.ecef_from_camera * Eigen::Vector3d::UnitZ();
  return std::acos(std::clamp(-view.dot(geo::upInEcef(place.lat, place.lon)), -1.0, 1.0));
}

capture::VerticalDatum datumOf(config::DatumChoice choice) {
  switch (choice) {
    case config::DatumChoice::Ellipsoid:
      return capture::VerticalDatum::Ellipsoid;
    case config::DatumChoice::Geoid:
      return capture::VerticalDatum::Geoid;
    case config::DatumChoice::Home:
      return capture::VerticalDatum::Home;
    case config::DatumChoice::Auto:
    case config::DatumChoice::Unknown:
      break;
  }
  return capture::VerticalDatum::Unknown;
}

}  // namespace

// A new map's place, from the images of the first frames.
Result<tiling::MapStore> Pipeline::makeMap(tiling::Mapper& mapper, tiling::MapGround& ground,
                                           const std::stop_token& stop) {
  config::Settings settings;
  capture::FlightInfo info;
  {
    const std::scoped_lock lock(mutex_);
    settings = settings_;
    info = flight_info_;
  }
  std::vector<tiling::Thumbnail> thumbnails;
  std::vector<capture::CameraModel> cameras;
  capture::VerticalDatum datum = capture::VerticalDatum::Unknown;  // the flight's word
  for (const Waiting& waiting : unsettled_) {
    auto thumbnail = persistently(stop, [&] {
      return onGl("thumbnail", [&] { return mapper.thumbnailOf(waiting.id, waiting.frame); });
    });
    if (!thumbnail) return tl::unexpected(thumbnail.error());
    thumbnails.push_back(std::move(*thumbnail));
    cameras.push_back(waiting.frame->camera);
    datum = waiting.frame->datum;
  }
  auto lattice = geo::TileLattice::parse(settings.map.lattice);
  if (!lattice) return fail(ErrorCode::BadSettings, "map.lattice: " + lattice.error().message);
  const auto settleOn = [&](std::optional<double> height_m) {
    tiling::GroundOptions options = tiling::groundOptions(settings);
    options.height_m = height_m;
    return tiling::Mapper::settleGround(thumbnails, cameras, *lattice, options);
  };
  auto settled = settleOn(std::nullopt);
  // What the flight says of the ground (take-off, say) is taken when the images do not contradict it: they
  // may show a wood's canopy.
  if (const auto said = info.ground_height_m) {
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
  // Heights are never shifted here: a setting can only name what the flight leaves open.
  const capture::VerticalDatum chosen = datumOf(settings.map.datum);
  if (settings.map.datum != config::DatumChoice::Auto && datum != capture::VerticalDatum::Unknown &&
      datum != chosen)
    return fail(
        ErrorCode::BadSettings,
        fmt::format("map.datum: the flight's heights are {}, and are not converted while mapping; leave "
                    "it at auto, and choose another datum when exporting",
                    capture::nameOf(datum)));
  meta.datum = settings.map.datum == config::DatumChoice::Auto ? datum : chosen;
  if (meta.datum == capture::VerticalDatum::Geoid)
    meta.geoid = info.geoid_model.empty() ? settings.map.geoid_model : info.geoid_model;
  meta.tile_size = settings.map.tile_size;
  meta.base_zoom = ground.base_zoom;
  meta.elevation_step_m = settings.store.elevation_step_m;
  meta.created_utc_ns = unsettled_.front().frame->time_ns + unsettled_.front().frame->utc_offset_ns;
  meta.extra = nlohmann::json{{"ground", asJson(ground)}}.dump();
  return tiling::MapStore::create(mapFile(), meta);
}

Result<void> Pipeline::settle(tiling::Mapper& mapper, const std::stop_token& stop) {
  tiling::MapGround ground;
  Result<tiling::MapStore> store = fail(ErrorCode::NotFound, "");
  if (std::filesystem::exists(mapFile())) {
    store = tiling::MapStore::open(mapFile());
    if (!store) return tl::unexpected(store.error());
    auto known = groundFrom(store->meta());
    if (!known) return tl::unexpected(known.error());
    ground = *known;
  } else {
    store = makeMap(mapper, ground, stop);
    if (!store) return tl::unexpected(store.error());
  }
  writer_ = std::make_unique<tiling::StoreWriter>(std::move(*store), tiling::StoreWriter::Options{});
  auto reader = writer_->reader();
  if (!reader) return tl::unexpected(reader.error());
  reader_.emplace(std::move(*reader));
  writer_->addListener([this](std::uint64_t, const std::vector<geo::TileKey>& tiles) {
    {
      const std::scoped_lock lock(mutex_);
      status_.tiles += tiles.size();
    }
    wake_.notify_all();  // the encoding thread measures when
    if (on_commit_) on_commit_();
  });
  has_writer_ = true;
  mapper.setGround(ground);
  const std::scoped_lock lock(mutex_);
  scheduler_ = std::make_unique<tiling::Scheduler>(mapper.cellZoom(), schedulerOptions(settings_));
  spdlog::info("map at zoom {} ({:.1f} cm a texel), ground near {:.1f} m, swept between {:.0f} and {:.0f} m",
               ground.base_zoom, 100 * ground.texel_m, ground.height_m, ground.min_height_m,
               ground.max_height_m);
  status_.settled = true;
  status_.gsd_m = ground.texel_m;
  return {};
}

Result<void> Pipeline::takeFrame(tiling::Mapper& mapper, const Waiting& waiting) {
  double max_tilt_deg = 180;
  {
    const std::scoped_lock lock(mutex_);
    max_tilt_deg = settings_.pose.max_tilt_deg;
  }
  if (tiltOf(*waiting.frame->pose) > geo::radians(max_tilt_deg)) {
    refuse(waiting.id, "tilted beyond pose.max_tilt_deg");
    return {};
  }
  const std::int64_t shutter_ns = shutterOf(*waiting.frame, waiting.arrived_ns);
  auto added = onGl("frame", [&] {
    return mapper.addFrame(waiting.id, waiting.frame,
                           [this, id = waiting.id] { return recorded_->load(id); });
  });
  if (!added) {
    if (added.error().code == ErrorCode::Unavailable) return tl::unexpected(added.error());
    refuse(waiting.id, added.error().message);
    return {};
  }
  const tiling::IndexedFrame& record = *mapper.index().find(waiting.id);
  if (record.near_vertical) scheduler_->cover(boxOf(record.footprint));
  const std::int64_t now = now_ns();
  std::vector<tiling::Tile> first_sight;
  std::vector<geo::TileKey> first_seen;
  for (const geo::TileKey& cell : *added) {
    scheduler_->mark(cell, tiling::knowledgeOf(mapper.index(), cell, mapper.ground().height_m, views_), now);
    if (waiting.again) scheduler_->markDue(cell, now);
    // A cell that shows nothing yet gets the plain projection at once.
    if (!seen_cells_.insert(cell).second) continue;
    first_seen.push_back(cell);
    auto tiles = onGl("first sight", [&] { return mapper.provisionalCell(cell); });
    if (!tiles) {
      if (tiles.error().code != ErrorCode::Unavailable) {
        warnOnce("first sight",
                 "no first sight of a cell, which has to wait for its sweep: " + tiles.error().message);
        continue;
      }
      for (const geo::TileKey& unpublished : first_seen) seen_cells_.erase(unpublished);
      return tl::unexpected(tiles.error());
    }
    for (tiling::Tile& tile : *tiles) first_sight.push_back(std::move(tile));
  }
  if (!added->empty() && !waiting.again) unswept_.try_emplace(waiting.id, shutter_ns);
  if (!first_sight.empty()) publish(std::move(first_sight), {{shutter_ns, false}});
  ++unbalanced_;
  tiling::FrameRecord stored = tiling::makeFrameRecord(waiting.id, *waiting.frame);
  stored.state = tiling::FrameState::Mapped;
  if (const auto image = recorded_->imageOf(waiting.id)) {
    std::error_code code;
    stored.path = image->lexically_relative(folder_).string();
    stored.bytes = std::filesystem::file_size(*image, code);
    if (code) stored.bytes = 0;
  }
  if (record.near_vertical) stored.box = boxOf(record.footprint);
  if (auto footprint = geo::footprint(record.camera, record.pose, record.ground_height_m))
    stored.footprint = *footprint;
  const std::scoped_lock lock(mutex_);
  encoding_.push_back({{}, {std::move(stored)}, {}, {}});
  wake_.notify_all();
  status_.mapped += waiting.again ? 0 : 1;
  return {};
}

void Pipeline::publish(std::vector<tiling::Tile> tiles, std::vector<Latency::Sight> sights,
                       std::vector<std::pair<std::string, std::string>> values) {
  std::size_t kept = 0;
  {
    const std::scoped_lock lock(mutex_);
    kept = static_cast<std::size_t>(settings_.clipmap.ram_mb) << 20;
  }
  for (const tiling::Tile& tile : tiles) {
    if (recent_.insert_or_assign(tile.key, std::make_shared<const tiling::Tile>(tile)).second)
      recent_order_.push_back(tile.key);
    while (recent_order_.size() > 16 && recent_order_.size() * tiling::TileCache::bytesOf(tile) > kept) {
      recent_.erase(recent_order_.front());
      recent_order_.pop_front();
    }
  }
  std::unique_lock lock(mutex_);
  while (encoding_.size() >= kTilesToEncode) {
    beat(Stage::Mapping);  // it is the encoding that has to get on
    wake_.wait_for(lock, 500ms, [&] { return encoding_.size() < kTilesToEncode; });
    if (status_.failed) return;
  }
  encoding_.push_back({std::move(tiles), {}, std::move(sights), std::move(values)});
  wake_.notify_all();
}

Result<void> Pipeline::makeParentOf(const geo::TileKey& key) {
  const std::int64_t start_ns = now_ns();
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
  if (!made.front().empty()) publish(std::move(made), {});
  const std::scoped_lock lock(mutex_);
  status_.parents_s += static_cast<double>(now_ns() - start_ns) / 1e9;
  return {};
}

Result<void> Pipeline::finish(tiling::Mapper& mapper, const geo::TileKey& cell) {
  mapper.setOptions(as_set_);  // for cells that have left memory and are swept again
  auto tiles = onGl("orthophoto", [&] { return mapper.finishCell(cell, tiling::Mapper::Around::AsSwept); });
  if (!tiles) return tl::unexpected(tiles.error());
  std::set<geo::TileKey> parents;
  std::vector<Latency::Sight> sights;
  std::vector<std::pair<std::string, std::string>> values;
  for (const tiling::Tile& tile : *tiles) {
    parents.insert(geo::parentOf(tile.key));
    values.emplace_back(fmt::format("made_at/{}/{}/{}", tile.key.zoom, tile.key.x, tile.key.y), madeAt(cell));
    std::uint32_t texels = 0;
    for (std::size_t i = 3; i < tile.color.size(); i += 4) texels += tile.color[i] != 0 ? 1 : 0;
    std::uint32_t& known = texels_[tile.key];
    all_texels_ += static_cast<double>(texels) - static_cast<double>(known);
    known = texels;
    for (const std::uint64_t id : tile.frame_set)
      if (const auto found = unswept_.find(id); found != unswept_.end()) {
        sights.push_back({found->second, true});
        unswept_.erase(found);
      }
  }
  publish(std::move(*tiles), std::move(sights), std::move(values));
  // Tiles between the cell's own zoom and level 0 lie wholly within the cell.
  for (int zoom = mapper.ground().base_zoom - 1; zoom >= mapper.cellZoom(); --zoom) {
    std::set<geo::TileKey> next;
    for (const geo::TileKey& key : parents) {
      if (auto ok = makeParentOf(key); !ok) return ok;
      next.insert(geo::parentOf(key));
    }
    parents = std::move(next);
  }
  return {};
}

Result<bool> Pipeline::work(tiling::Mapper& mapper, const tiling::TileJob& job) {
  Result<void> done;
  switch (job.kind) {
    case tiling::TileJob::Kind::Sweep:
      return sweepAtPoint(mapper, job.key);
    case tiling::TileJob::Kind::Finish:
      done = finish(mapper, job.key);
      break;
    case tiling::TileJob::Kind::FromChildren:
      done = makeParentOf(job.key);
      break;
    case tiling::TileJob::Kind::Top:  // for the preview alone
      break;
  }
  if (!done) return tl::unexpected(done.error());
  return true;
}

// Equal exposures: the colours of frames whose gain has changed are made again when there is time.
void Pipeline::balance(tiling::Mapper& mapper) {
  unbalanced_ = 0;
  for (const geo::TileKey& cell : mapper.balanceExposure())
    if (seen_cells_.contains(cell)) scheduler_->markStale(cell, now_ns());
}

void Pipeline::map(const std::stop_token& stop) {
  std::unique_ptr<tiling::Mapper> owned;
  tiling::MapperOptions options;
  {
    const std::scoped_lock lock(mutex_);
    options = tiling::mapperOptions(settings_);
  }
  views_ = options.views;
  views_.max_views = options.sweep.max_views;
  auto created = gl_.submit(gl::Priority::Mapping, "mapper",
                            [&](gl::Context& context) -> Result<void> {
                              auto made = tiling::Mapper::create(context, options);
                              if (!made) return tl::unexpected(made.error());
                              owned = std::move(*made);
                              mapper_ = owned.get();
                              generation_ = gl_.generation();
                              beginGoverning(context.info().renderer);
                              owned->onPause([this, stop] { return pauseOnGl(stop); });
                              return {};
                            })
                     .get();
  if (!created) return giveUp(created.error());
  // What it holds on the GPU is given back there, however this ends.
  const auto giveBack = [&] {
    (void)gl_
        .submit(gl::Priority::Mapping, "mapper",
                [&](gl::Context&) -> Result<void> {
                  mapper_ = nullptr;
                  owned.reset();
                  return {};
                })
        .get();
  };
  try {
    mapUntil(*owned, stop);
  } catch (...) {
    giveBack();
    throw;
  }
  giveBack();
  keepSpeed();
}

// A frame's turn. False: the pipeline cannot go on.
bool Pipeline::takeNext(tiling::Mapper& mapper, Waiting waiting, const std::stop_token& stop) {
  const auto took = [&](const Waiting& frame) {
    auto ok = persistently(stop, [&] { return takeFrame(mapper, frame); });
    if (!ok) stopped(ok.error(), stop);
    return ok.has_value();
  };
  if (waiting.frame == nullptr) {
    auto loaded = recorded_->load(waiting.id);
    if (!loaded) {
      refuse(waiting.id, loaded.error().message);
      return true;
    }
    waiting.frame = *loaded;
  }
  if (!waiting.frame->pose) {
    const std::string& reason = waiting.frame->no_pose_reason;
    refuse(waiting.id, reason.empty() ? "no pose" : reason);
    return true;
  }
  if (scheduler_) return took(waiting);
  std::erase_if(unsettled_, [&](const Waiting& held) { return held.id == waiting.id; });
  unsettled_.push_back(std::move(waiting));
  if (unsettled_.size() < kSettlingFrames && !std::filesystem::exists(mapFile())) return true;
  if (auto ok = settle(mapper, stop); !ok) {
    if (ok.error().code != ErrorCode::Unavailable) {
      giveUp(ok.error());
      return false;
    }
    unsettled_reason_ = ok.error().message;
    if (unsettled_.size() > 4 * kSettlingLimit) unsettled_.erase(unsettled_.begin());
    return true;
  }
  const std::vector<Waiting> held = std::move(unsettled_);
  return std::all_of(held.begin(), held.end(), took);
}

// Frames come before cells, but do not starve them: when cells wait too long, they get as much time as the
// frames have taken.
bool Pipeline::cellsFirst() const {
  if (!scheduler_ || owed_s_ <= 0) return false;
  const double starved_s = std::min(governorOptions(quality_).latency_s / 3, kStarved_s);
  return static_cast<double>(scheduler_->overdue(now_ns())) / 1e9 > starved_s;
}

void Pipeline::showProgress(const tiling::Mapper& mapper) {
  const std::int64_t now = now_ns();
  const std::scoped_lock lock(mutex_);
  status_.mapper = mapper.statistics();
  status_.quality = qualityStatus();
  status_.cells = seen_cells_.size();
  if (!scheduler_) return;
  status_.waiting_cells = scheduler_->waitingTiles();
  status_.lag_s = static_cast<double>(scheduler_->overdue(now)) / 1e9;
  status_.area_m2 = all_texels_ * status_.gsd_m * status_.gsd_m;
}

void Pipeline::mapUntil(tiling::Mapper& mapper, const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    beat(Stage::Mapping);
    std::optional<Waiting> waiting;
    bool ended = false, reloaded = false;
    config::Settings settings;
    {
      const std::scoped_lock lock(mutex_);
      if (status_.failed) return;
      if (scheduler_)
        for (const geo::TileKey& key : interests_) scheduler_->requested(key, now_ns());
      interests_.clear();
      if (!frames_.empty() && !cellsFirst()) {
        waiting = std::move(frames_.front());
        frames_.pop_front();
      }
      ended = all_handed_on_ && frames_.empty() && !waiting;
      std::swap(reloaded, reloaded_);
      if (reloaded) settings = settings_;
    }
    if (reloaded) {
      reloadQuality(settings);
      mapper.setOptions(as_set_);
      if (scheduler_) scheduler_->setOptions(schedulerOptions(settings));
    }
    if (waiting) {
      begin(Stage::Mapping);
      const std::int64_t start_ns = now_ns();
      if (!takeNext(mapper, std::move(*waiting), stop)) return;
      const double took_s = static_cast<double>(now_ns() - start_ns) / 1e9;
      governor_->tookFrames(took_s * throttling_.headroom);
      owed_s_ = std::min(owed_s_ + took_s, kMostOwed_s);
      if (scheduler_ && unbalanced_ >= kBalanceFrames) balance(mapper);
      showProgress(mapper);
      continue;
    }
    if (scheduler_) {
      landed_ = ended;
      scheduler_->setLanded(ended);
      if (ended && unbalanced_ > 0) balance(mapper);
    }
    const auto job = scheduler_ ? scheduler_->next(now_ns()) : std::nullopt;
    if (!job) {
      owed_s_ = 0;
      if (scheduler_ && improveWorst()) continue;
      showProgress(mapper);
      std::unique_lock lock(mutex_);
      // The source may have ended since this round began: what follows the last frame is then still to do.
      const bool up_to_date = ended || !status_.source_ended;
      status_.idle = up_to_date && frames_.empty() && to_adjust_.empty() && status_.adjust.waiting == 0 &&
                     (!scheduler_ || scheduler_->idle()) && encoding_.empty() && !writing_;
      if (ended && !scheduler_ && !unsettled_reason_.empty() && !status_.failed) {
        status_.failed = true;
        status_.error = unsettled_reason_;
      }
      wake_.wait_for(lock, stop, 50ms, [&] { return !frames_.empty(); });
      continue;
    }
    {
      const std::scoped_lock lock(mutex_);
      status_.idle = false;
    }
    begin(Stage::Mapping);
    const std::int64_t start_ns = now_ns();
    const auto made = persistently(stop, [&] { return work(mapper, *job); });
    const double worked_s = static_cast<double>(now_ns() - start_ns) / 1e9;
    owed_s_ = std::max(0.0, owed_s_ - worked_s);
    if (job->kind != tiling::TileJob::Kind::Sweep) alsoSpent(worked_s);
    if (made) {
      scheduler_->done(*job, *made, now_ns());
    } else {
      if (made.error().code == ErrorCode::Unavailable) return stopped(made.error(), stop);
      warnOnce("tile",
               fmt::format("tile {}/{}/{}: {}", job->key.zoom, job->key.x, job->key.y, made.error().message));
      scheduler_->failed(*job, now_ns());
      if (job->kind == tiling::TileJob::Kind::Sweep) cheap_.erase(job->key);  // not to be improved for ever
    }
    showProgress(mapper);
    rest(worked_s);
  }
}

}  // namespace overfly::daemon
