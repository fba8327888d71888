#include "daemon/overflyd/backend.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "daemon/overflyd/live.h"

namespace overfly::daemon {

namespace {

link::Mission forTheLink(const MissionInfo& mission) {
  return {mission.name, mission.name, mission.map, mission.started_utc_ns, mission.live, mission.current};
}

nlohmann::json asJson(const Latency::Summary& latency) {
  return {{"frames", latency.frames},
          {"last_s", latency.last},
          {"median_s", latency.median},
          {"p95_s", latency.p95}};
}

}  // namespace

PipelineStatus Backend::status() const {
  if (const auto pipeline = missions_.current()) return pipeline->status();
  PipelineStatus none;
  none.source = "none";
  none.source_ended = none.idle = true;
  return none;
}

std::vector<link::Mission> Backend::missions() const {
  std::vector<link::Mission> missions;
  for (const MissionInfo& mission : missions_.list()) missions.push_back(forTheLink(mission));
  return missions;
}

Result<link::Mission> Backend::startMission(const std::string& name) {
  auto started = missions_.start(name);
  if (!started) return tl::unexpected(started.error());
  return forTheLink(*started);
}

void Backend::interest(const geo::TileKey& key) {
  if (const auto pipeline = missions_.current()) pipeline->interest(key);
}

std::string Backend::statusJson() const {
  const PipelineStatus s = status();
  nlohmann::json json{
      {"mission", {{"name", missions_.currentName()}, {"live", !s.source_ended}}},
      {"source", {{"name", s.source}, {"open", s.source_open}, {"ended", s.source_ended}}},
      {"frames",
       {{"seen", s.seen},
        {"mapped", s.mapped},
        {"waiting", s.waiting_frames},
        {"late_poses", s.late_poses},
        {"refused", s.refused}}},
      {"adjust",
       {{"adjusted", s.adjust.adjusted},
        {"held_back", s.adjust.held_back},
        {"revised", s.adjust.revised},
        {"batches", s.adjust.batches},
        {"rms_px", s.adjust.rms_px},
        {"median_s", s.adjust_median_s},
        {"p95_s", s.adjust_p95_s},
        {"landing_s", s.landing_s}}},
      {"tiles", {{"written", s.tiles}, {"waiting_cells", s.waiting_cells}}},
      {"survey", {{"gsd_m", s.gsd_m}, {"area_m2", s.area_m2}}},
      {"lag_s", s.lag_s},
      {"latency", {{"provisional", asJson(s.provisional_s)}, {"swept", asJson(s.swept_s)}}},
      {"state", s.failed                   ? "failed"
                : !s.store_problem.empty() ? "degraded"
                : !s.settled               ? "waiting"
                : s.idle                   ? "idle"
                                           : "mapping"},
      {"problem", s.failed ? s.error : s.store_problem},
      {"stuck", s.stuck},
      {"gpu_failures", s.gpu_failures},
      {"stages_s",
       {{"record", s.record_s},
        {"rectify", s.mapper.rectify_s},
        {"match_images", s.mapper.match_s},
        {"sweep", s.mapper.sweep_s},
        {"blend", s.mapper.blend_s},
        {"orthophoto", s.mapper.ortho_s},
        {"parents", s.parents_s},
        {"encode", s.encode_s}}},
      {"quality",
       {{"mode", s.quality.mode},
        {"point", s.quality.point},
        {"index", s.quality.index},
        {"points", s.quality.points},
        {"nmad_gsd", s.quality.nmad_gsd},
        {"complete", s.quality.complete},
        {"cell_s", s.quality.cell_s},
        {"backlog_s", s.quality.backlog_s},
        {"to_improve", s.quality.to_improve},
        {"changes", s.quality.changes},
        {"headroom", s.quality.headroom},
        {"throttled", s.quality.throttled}}},
      {"cells", {{"seen", s.cells}, {"swept", s.mapper.cells_swept}, {"finished", s.mapper.cells_finished}}}};
  if (const auto pipeline = missions_.current(); pipeline && pipeline->live() != nullptr)
    json["live"] = liveJson(pipeline->live()->status());
  return json.dump();
}

Result<std::string> Backend::frontJson() const {
  const PipelineStatus s = status();
  const QualityStatus& quality = s.quality;
  if (!quality.front) return fail(ErrorCode::Unavailable, "no mission has begun to map yet");
  auto points = nlohmann::json::array();
  for (std::size_t i = 0; i < quality.front->size(); ++i) {
    const OperatingPoint& point = (*quality.front)[i];
    points.push_back({{"name", point.name},
                      {"nmad_gsd", point.nmad_gsd},
                      {"complete", point.complete},
                      {"error_gsd", point.error()},
                      {"relative_time", point.relative_time},
                      {"cell_s", quality.front_cell_s[i]}});
  }
  return nlohmann::json{{"mode", quality.mode},
                        {"aim_s", std::isfinite(quality.aim_s) ? nlohmann::json(quality.aim_s) : nullptr},
                        {"index", quality.index},
                        {"points", points}}
      .dump();
}

std::string Backend::metricsText() const {
  const PipelineStatus s = status();
  std::string text;
  const auto metric = [&](const char* name, const char* kind, const char* help, double value) {
    text += fmt::format("# HELP {0} {1}\n# TYPE {0} {2}\n{0} {3}\n", name, help, kind, value);
  };
  metric("overfly_frames_seen_total", "counter", "frames from the source", static_cast<double>(s.seen));
  metric("overfly_frames_mapped_total", "counter", "frames in the index", static_cast<double>(s.mapped));
  metric("overfly_frames_waiting", "gauge", "frames not yet in the index",
         static_cast<double>(s.waiting_frames));
  metric("overfly_frames_adjusted_total", "counter", "frames mapped with an adjusted pose",
         static_cast<double>(s.adjust.adjusted));
  metric("overfly_frames_revised_total", "counter", "frames mapped again because their pose was corrected",
         static_cast<double>(s.adjust.revised));
  std::uint64_t held_back = 0;
  for (const auto& [reason, count] : s.adjust.held_back) held_back += count;
  metric("overfly_frames_held_back", "gauge", "frames that wait for a usable pose",
         static_cast<double>(held_back));
  metric("overfly_adjust_p95_seconds", "gauge", "time of a frame's adjustment, 95th percentile",
         s.adjust_p95_s);
  metric("overfly_gpu_failures_total", "counter",
         "times that the GPU was lost or out of memory while mapping; the work was done again",
         static_cast<double>(s.gpu_failures));
  metric("overfly_tiles_written_total", "counter", "tiles written, updates counted",
         static_cast<double>(s.tiles));
  metric("overfly_cells_waiting", "gauge", "cells that wait to be swept",
         static_cast<double>(s.waiting_cells));
  metric("overfly_lag_seconds", "gauge", "age of the oldest frame that is not in its tiles", s.lag_s);
  metric("overfly_latency_provisional_seconds", "gauge",
         "shutter to a provisional tile on the link, 95th percentile", s.provisional_s.p95);
  metric("overfly_latency_swept_seconds", "gauge", "shutter to a swept tile on the link, 95th percentile",
         s.swept_s.p95);
  metric("overfly_stages_stuck", "gauge", "stages of the pipeline that do not get on",
         static_cast<double>(s.stuck.size()));
  metric("overfly_sweep_seconds_total", "counter", "time spent sweeping", s.mapper.sweep_s);
  metric("overfly_quality_point", "gauge", "operating point of the sweep, 1 is the fastest",
         static_cast<double>(s.quality.index));
  metric("overfly_quality_points", "gauge", "operating points on the front",
         static_cast<double>(s.quality.points));
  metric("overfly_quality_cells_to_improve", "gauge", "cells made at a faster point than the last",
         static_cast<double>(s.quality.to_improve));
  metric("overfly_quality_backlog_seconds", "gauge", "until everything that waits is swept",
         s.quality.backlog_s);
  metric("overfly_quality_headroom", "gauge", "share of the processor's speed that heat leaves",
         s.quality.headroom);
  metric("overfly_orthophoto_seconds_total", "counter", "time spent colouring", s.mapper.ortho_s);
  if (const auto pipeline = missions_.current(); pipeline && pipeline->live() != nullptr)
    text += liveMetrics(pipeline->live()->status());
  return text;
}

link::Health Backend::health() const {
  const PipelineStatus s = status();
  if (s.failed) return {false, s.error};
  if (!s.stuck.empty()) return {false, "the " + s.stuck.front() + " stage does not get on"};
  if (!s.store_problem.empty()) return {false, s.store_problem};
  return {};
}

}  // namespace overfly::daemon
