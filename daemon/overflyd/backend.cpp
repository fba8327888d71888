#include "daemon/overflyd/backend.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "daemon/overflyd/live.h"

namespace overfly::daemon {

std::vector<std::string> missionsIn(const std::filesystem::path& root) {
  std::vector<std::string> names;
  std::error_code code;
  for (const auto& entry : std::filesystem::directory_iterator(root, code))
    if (std::filesystem::exists(entry.path() / "map.overfly"))
      names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

std::vector<link::Mission> Backend::missions() const {
  std::vector<link::Mission> missions;
  for (const std::string& name : missionsIn(root_)) {
    const bool current = name == mission_;
    missions.push_back(
        {name, name, root_ / name / "map.overfly", 0, current && !pipeline_.status().source_ended, current});
  }
  return missions;
}

std::string Backend::statusJson() const {
  const PipelineStatus s = pipeline_.status();
  nlohmann::json json{{"mission", {{"name", mission_}, {"live", !s.source_ended}}},
                      {"source", {{"name", s.source}, {"open", s.source_open}, {"ended", s.source_ended}}},
                      {"frames",
                       {{"seen", s.seen},
                        {"mapped", s.mapped},
                        {"waiting", s.waiting_frames},
                        {"late_poses", s.late_poses},
                        {"refused", s.refused}}},
                      {"tiles", {{"written", s.tiles}, {"waiting_cells", s.waiting_cells}}},
                      {"lag_s", s.lag_s},
                      {"first_sight_s", s.first_sight_s},
                      {"state", s.failed                   ? "failed"
                                : !s.store_problem.empty() ? "degraded"
                                : !s.settled               ? "waiting"
                                : s.idle                   ? "idle"
                                                           : "mapping"},
                      {"problem", s.failed ? s.error : s.store_problem},
                      {"stages_s",
                       {{"rectify", s.mapper.rectify_s},
                        {"match_images", s.mapper.match_s},
                        {"sweep", s.mapper.sweep_s},
                        {"blend", s.mapper.blend_s},
                        {"orthophoto", s.mapper.ortho_s}}},
                      {"cells", {{"swept", s.mapper.cells_swept}, {"finished", s.mapper.cells_finished}}}};
  if (const capture::LiveSource* live = pipeline_.live()) json["live"] = liveJson(live->status());
  return json.dump();
}

std::string Backend::metricsText() const {
  const PipelineStatus s = pipeline_.status();
  std::string text;
  const auto metric = [&](const char* name, const char* kind, const char* help, double value) {
    text += fmt::format("# HELP {0} {1}\n# TYPE {0} {2}\n{0} {3}\n", name, help, kind, value);
  };
  metric("overfly_frames_seen_total", "counter", "frames from the source", static_cast<double>(s.seen));
  metric("overfly_frames_mapped_total", "counter", "frames in the index", static_cast<double>(s.mapped));
  metric("overfly_frames_waiting", "gauge", "frames not yet in the index",
         static_cast<double>(s.waiting_frames));
  metric("overfly_tiles_written_total", "counter", "tiles written, updates counted",
         static_cast<double>(s.tiles));
  metric("overfly_cells_waiting", "gauge", "cells that wait to be swept",
         static_cast<double>(s.waiting_cells));
  metric("overfly_lag_seconds", "gauge", "age of the oldest frame that is not in its tiles", s.lag_s);
  metric("overfly_sweep_seconds_total", "counter", "time spent sweeping", s.mapper.sweep_s);
  metric("overfly_orthophoto_seconds_total", "counter", "time spent colouring", s.mapper.ortho_s);
  if (const capture::LiveSource* live = pipeline_.live()) text += liveMetrics(live->status());
  return text;
}

link::Health Backend::health() const {
  const PipelineStatus s = pipeline_.status();
  if (s.failed) return {false, s.error};
  if (!s.store_problem.empty()) return {false, s.store_problem};
  return {};
}

}  // namespace overfly::daemon
