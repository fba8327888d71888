#include "daemon/tradeoff/adjust_trials.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "capture/geo/geodetic.h"
#include "capture/geo/similarity.h"
#include "capture/import/import_flight.h"
#include "tiling/adjust/flight_adjust.h"

namespace overfly::tradeoff {
namespace {

struct Setting {
  std::string axis, text;
  bool is_default = false;
  tiling::adjust::AdjusterOptions options;
};

std::vector<Setting> settings(bool quick) {
  using tiling::adjust::FeatureKind;
  std::vector<Setting> list;
  const auto add = [&](const std::string& axis, const std::string& text, auto&& change) {
    Setting setting{axis, text, axis == "default", {}};
    change(setting.options);
    list.push_back(std::move(setting));
  };
  const auto& standard = tiling::adjust::AdjusterOptions{};
  add("default",
      fmt::format("SIFT, {} features, window {}", standard.features.most, standard.map.window_frames),
      [](auto&) {});
  for (const int most : {400, 800, 1500, 4000})
    if (!quick || most == 800)
      add("features", fmt::format("{} features", most), [&](auto& o) { o.features.most = most; });
  for (const int side : {500, 1200})
    if (!quick || side == 500)
      add("resolution", fmt::format("long side {} px", side),
          [&](auto& o) { o.features.long_side_px = side; });
  for (const auto& [kind, name] :
       {std::pair{FeatureKind::Akaze, "AKAZE"}, std::pair{FeatureKind::Orb, "ORB"}})
    add("kind", name, [kind = kind](auto& o) { o.features.kind = kind; });
  if (!quick)
    for (const int window : {4, 16})
      add("window", fmt::format("window {}", window), [&](auto& o) { o.map.window_frames = window; });
  return list;
}

}  // namespace

Result<std::vector<Trial>> tryAdjustment(
    const std::filesystem::path& folder, bool quick,
    const std::function<void(std::size_t, std::size_t, const std::string&)>& progress) {
  auto reference = capture::importFlight(folder);
  if (!reference) return tl::unexpected(reference.error());
  auto raw = capture::importFlight(folder, {.raw = true, .camera_file = {}});
  if (!raw) return tl::unexpected(raw.error());
  if (!std::any_of(raw->frames().begin(), raw->frames().end(),
                   [](const auto& f) { return f.raw != nullptr; }))
    return fail(ErrorCode::NotFound, folder.string() + " has no raw telemetry to adjust from");
  std::map<std::string, const capture::Pose*> known;
  for (const capture::FlightFrame& frame : reference->frames())
    if (frame.frame.pose && frame.frame.pose_is_adjusted) known.emplace(frame.frame.name, &*frame.frame.pose);
  if (known.size() < 3)
    return fail(ErrorCode::NotFound, folder.string() + " has no adjusted poses to compare with");

  std::vector<Trial> trials;
  const std::vector<Setting> list = settings(quick);
  for (std::size_t i = 0; i < list.size(); ++i) {
    progress(i, list.size(), list[i].text);
    tiling::adjust::FlightAdjustOptions options;
    options.adjuster = list[i].options;
    Result<tiling::adjust::FlightAdjustment> adjusted = fail(ErrorCode::Internal, "not run");
    const Elapsed elapsed = elapsedOf([&] { adjusted = tiling::adjust::adjustFlight(*raw, options); });
    if (!adjusted) return tl::unexpected(adjusted.error());
    std::vector<Eigen::Vector3d> from, to;
    std::vector<const capture::Pose*> mine, theirs;
    std::optional<geo::LocalFrame> local;
    for (const capture::FlightFrame& frame : adjusted->flight.frames()) {
      const auto found = known.find(frame.frame.name);
      if (!frame.frame.pose || !frame.frame.pose_is_adjusted || found == known.end()) continue;
      if (!local) local.emplace(geo::geodeticFromEcef(found->second->position_in_ecef));
      mine.push_back(&*frame.frame.pose);
      theirs.push_back(found->second);
      from.push_back(local->enuFromEcef(mine.back()->position_in_ecef));
      to.push_back(local->enuFromEcef(theirs.back()->position_in_ecef));
    }
    Trial trial{.part = "adjustment",
                .axis = list[i].axis,
                .setting = list[i].text,
                .is_default = list[i].is_default};
    const auto frames = static_cast<double>(raw->size());
    trial.processor = timingOf({elapsed.processor_ms / frames});
    trial.wall = timingOf({elapsed.wall_ms / frames});
    trial.error_name = "RMS of camera centres after a similarity, m";
    trial.error = std::numeric_limits<double>::infinity();
    double angle = 0;
    if (from.size() >= 3) {
      const geo::Similarity map = geo::similarityBetween(from, to);
      const Eigen::Matrix3d enu_from_ecef = local->enuFromEcefRotation();
      double squares = 0;
      for (std::size_t k = 0; k < from.size(); ++k) {
        squares += (map(from[k]) - to[k]).squaredNorm();
        const Eigen::Vector3d ours =
            map.turn * enu_from_ecef * (mine[k]->ecef_from_camera * Eigen::Vector3d::UnitZ());
        const Eigen::Vector3d other =
            enu_from_ecef * (theirs[k]->ecef_from_camera * Eigen::Vector3d::UnitZ());
        angle += std::atan2(ours.cross(other).norm(), ours.dot(other)) / static_cast<double>(from.size());
      }
      trial.error = std::sqrt(squares / static_cast<double>(from.size()));
    }
    double rms_px = 0;
    for (const auto& camera : adjusted->cameras) rms_px = std::max(rms_px, camera.summary.rms_px);
    trial.figures = {{"adjusted", static_cast<double>(from.size()) / static_cast<double>(known.size())},
                     {"direction_deg", geo::degrees(angle)},
                     {"rms_px", rms_px}};
    trials.push_back(std::move(trial));
  }
  progress(list.size(), list.size(), "");
  markFront(trials);
  return trials;
}

}  // namespace overfly::tradeoff
