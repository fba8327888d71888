#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "daemon/overflyd/boot_clock.h"
#include "daemon/overflyd/options.h"
#include "daemon/overflyd/pipeline.h"
#include "tiling/mapping/mapper_settings.h"

// At which point of the front of accuracy against time cells are swept, on the mapping thread.
namespace overfly::daemon {
namespace {

constexpr std::size_t kImprovedAtOnce = 4;  // cells made better before it looks again whether frames came
constexpr std::int64_t kHeatLook_ns = 5'000'000'000;
constexpr double kLongestRest_s = 1;

// In deviceFolder().
constexpr const char* kTableFile =
    "operating_points.json";                      // an owner's own table, instead of the shipped one
constexpr const char* kSpeedFile = "speed.json";  // what a sweep takes on this device

OperatingTable tableIn(const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / kTableFile;
  std::ifstream file(path, std::ios::binary);
  if (!file) return OperatingTable::shipped();
  std::ostringstream text;
  text << file.rdbuf();
  auto table = OperatingTable::parse(text.str());
  if (table) return std::move(*table);
  spdlog::warn("{}: {}; the table that the program brings along is used", path.string(),
               table.error().message);
  return OperatingTable::shipped();
}

// Seconds of a cell's sweep at the most accurate point in the last run on this renderer; 0: not known.
double knownSpeed(const std::filesystem::path& folder, const std::string& renderer) {
  std::ifstream file(folder / kSpeedFile);
  const nlohmann::json known = nlohmann::json::parse(file, nullptr, false);
  if (!known.is_object() || known.value("renderer", "") != renderer) return 0;
  const auto seconds = known.find("seconds_per_cell");
  return seconds != known.end() && seconds->is_number() ? std::max(0.0, seconds->get<double>()) : 0;
}

const char* nameOf(config::QualityMode mode) {
  switch (mode) {
    case config::QualityMode::Realtime:
      return "realtime";
    case config::QualityMode::Best:
      return "best";
    case config::QualityMode::Balanced:
      break;
  }
  return "balanced";
}

}  // namespace

void Pipeline::beginGoverning(const std::string& renderer) {
  config::Settings settings;
  {
    const std::scoped_lock lock(mutex_);
    settings = settings_;
  }
  as_set_ = tiling::mapperOptions(settings);
  quality_ = settings.quality;
  renderer_ = renderer;
  table_ = std::make_shared<const OperatingTable>(tableIn(deviceFolder(settings)));
  governor_ = std::make_unique<Governor>(*table_, governorOptions(quality_),
                                         knownSpeed(deviceFolder(settings), renderer));
}

void Pipeline::reloadQuality(const config::Settings& settings) {
  as_set_ = tiling::mapperOptions(settings);
  quality_ = settings.quality;
  governor_->setOptions(governorOptions(quality_));
}

void Pipeline::keepSpeed() const {
  if (!governor_ || governor_->deviceSeconds() <= 0) return;
  std::filesystem::path folder;
  {
    const std::scoped_lock lock(mutex_);
    folder = deviceFolder(settings_);
  }
  std::error_code code;  // without it the next run measures anew
  const std::filesystem::path fresh = folder / fmt::format("{}.new", kSpeedFile);
  std::ofstream file(fresh);
  file << nlohmann::json{{"renderer", renderer_}, {"seconds_per_cell", governor_->deviceSeconds()}}.dump()
       << '\n';
  file.close();
  if (file) std::filesystem::rename(fresh, folder / kSpeedFile, code);
}

tiling::MapperOptions Pipeline::optionsAt(std::size_t point) const {
  tiling::MapperOptions options = as_set_;
  if (point < governor_->best()) options.sweep = (*table_)[point].applied(options.sweep);
  return options;
}

Result<bool> Pipeline::sweepAtPoint(tiling::Mapper& mapper, const geo::TileKey& cell) {
  const std::int64_t start_ns = now_ns();
  if (start_ns - heat_looked_at_ns_ > kHeatLook_ns) {
    heat_looked_at_ns_ = start_ns;
    Throttling heat = readThrottling();
    if (heat.headroom < throttling_.headroom) spdlog::warn("throttled: {}", heat.reason);
    throttling_ = std::move(heat);
  }
  const std::size_t before = governor_->point();
  const std::size_t governed =
      governor_->decide({.now_s = static_cast<double>(start_ns) / 1e9,
                         .waiting_cells = static_cast<double>(scheduler_->worthTiles()),
                         .cells_due = scheduler_->worthSoFar(),
                         .headroom = throttling_.headroom,
                         .landed = landed_});
  if (governed != before)
    spdlog::info("quality: point {} of {} -> {} ({}); {} cells wait, {:.1f} s at this point, {:.0f} ms each",
                 before + 1, table_->size(), governed + 1, (*table_)[governed].name, scheduler_->worthTiles(),
                 governor_->backlog(), 1000 * governor_->secondsPerCell(governed));
  const bool improving = improving_.erase(cell) > 0;
  only_improving_ = improving;
  const std::size_t point = improving ? governor_->best() : governed;
  mapper.setOptions(optionsAt(point));
  const std::uint64_t swept_before = mapper.statistics().cells_swept;
  auto changed = onGl("sweep", [&] { return mapper.sweepCell(cell); });
  if (!changed) return changed;
  if (mapper.statistics().cells_swept > swept_before)
    governor_->swept(point, static_cast<double>(now_ns() - start_ns) / 1e9 * throttling_.headroom);
  if (point < governor_->best()) {
    cheap_.insert_or_assign(cell, point);
    return changed;
  }
  // It may have been swept like this for a neighbour's sake already, after it had left memory: what was made
  // from the cheap sweep is to be made again all the same.
  return *changed || cheap_.erase(cell) > 0;
}

bool Pipeline::improveWorst() {
  std::vector<std::pair<std::size_t, geo::TileKey>> worst;
  for (const auto& [cell, point] : cheap_)
    if (!scheduler_->waits(cell)) worst.emplace_back(point, cell);
  if (worst.empty()) return false;
  // After the last frame all at once: sweeps come before all finishing then, and no cell is blended twice.
  const std::size_t count = landed_ ? worst.size() : std::min(kImprovedAtOnce, worst.size());
  std::partial_sort(worst.begin(), worst.begin() + static_cast<std::ptrdiff_t>(count), worst.end());
  for (std::size_t i = 0; i < count; ++i) {
    improving_.insert(worst[i].second);
    scheduler_->markImprovable(worst[i].second, now_ns());
  }
  return true;
}

std::string Pipeline::madeAt(const geo::TileKey& cell) const {
  const auto cheap = cheap_.find(cell);
  return cheap == cheap_.end() ? "" : (*table_)[cheap->second].name;
}

void Pipeline::alsoSpent(double seconds) {
  // What improvements bring with them comes out of spare time.
  if (!only_improving_) governor_->alsoSpent(seconds * throttling_.headroom);
}

void Pipeline::rest(double worked_s) {
  const double share = governorOptions(quality_).share;
  if (share >= 1 || share <= 0 || closing_) return;
  const std::chrono::duration<double> pause(std::min(worked_s * (1 / share - 1), kLongestRest_s));
  std::unique_lock lock(mutex_);
  wake_.wait_for(lock, pause, [this] { return closing_.load() || !frames_.empty(); });
}

QualityStatus Pipeline::qualityStatus() const {
  QualityStatus status;
  status.mode = nameOf(quality_.mode);
  if (!governor_) return status;
  const OperatingPoint& point = governor_->operatingPoint();
  status.point = point.name;
  status.index = governor_->point() + 1;
  status.points = table_->size();
  status.nmad_gsd = point.nmad_gsd;
  status.complete = point.complete;
  status.cell_s = governor_->secondsPerCell(governor_->point());
  status.backlog_s = governor_->backlog();
  status.to_improve = cheap_.size();
  status.changes = governor_->changes();
  status.headroom = throttling_.headroom;
  status.throttled = throttling_.reason;
  status.aim_s = governorOptions(quality_).latency_s;
  status.front = table_;
  for (std::size_t i = 0; i < table_->size(); ++i)
    status.front_cell_s.push_back(governor_->secondsPerCell(i));
  return status;
}

}  // namespace overfly::daemon
