#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "capture/geo/geodetic.h"
#include "capture/import/import_flight.h"
#include "daemon/cli/command.h"
#include "daemon/cli/progress.h"
#include "tiling/adjust/flight_adjust.h"

namespace overfly::cli {
namespace {

using tiling::adjust::FlightAdjustment;
using tiling::adjust::FrameState;

struct Arguments {
  std::string flight, out, camera, control;
};

const char* nameOf(FrameState state) {
  switch (state) {
    case FrameState::Adjusted:
      return "adjusted";
    case FrameState::PriorOnly:
      return "telemetry";
    case FrameState::Waiting:
    case FrameState::HeldBack:
      break;
  }
  return "held back";
}

nlohmann::json asJson(const FlightAdjustment& result, const capture::Flight& flight) {
  nlohmann::json out;
  for (const auto& f : result.frames) {
    const auto& pose = f.pose;
    nlohmann::json frame{{"name", flight.at(f.index).frame.name},
                         {"state", nameOf(pose.state)},
                         {"observations", pose.observations},
                         {"rms_px", pose.rms_px},
                         {"shift_px", pose.shift_px}};
    if (!pose.reason.empty()) frame["reason"] = pose.reason;
    if (!f.assumed.empty()) frame["assumed"] = f.assumed;
    if (pose.state == FrameState::Adjusted) {
      const auto place = geo::geodeticFromEcef(pose.pose.position_in_ecef);
      const auto& q = pose.pose.ecef_from_camera;
      frame["lat"] = geo::degrees(place.lat);
      frame["lon"] = geo::degrees(place.lon);
      frame["height_m"] = place.height_m;
      frame["ecef_from_camera_wxyz"] = {q.w(), q.x(), q.y(), q.z()};
      const auto sigma = pose.pose.covariance.diagonal().cwiseSqrt();
      frame["sigma_enu_m"] = {sigma[0], sigma[1], sigma[2]};
      frame["sigma_rotation_deg"] = {geo::degrees(sigma[3]), geo::degrees(sigma[4]), geo::degrees(sigma[5])};
    }
    out["frames"].push_back(std::move(frame));
  }
  for (const auto& c : result.cameras) {
    const auto& s = c.summary;
    nlohmann::json camera{{"id", c.camera_id},
                          {"frames", s.frames},
                          {"adjusted", s.adjusted},
                          {"points", s.points},
                          {"observations", s.observations},
                          {"rms_px", s.rms_px},
                          {"delay_s", s.shared.delay_s},
                          {"delay_sigma_s", s.sigmas.delay_s},
                          {"noise_horizontal_m", s.noise_horizontal_m},
                          {"noise_vertical_m", s.noise_vertical_m},
                          {"dome_sigma_m", s.dome.sigma_m},
                          {"noise_tilt_deg", geo::degrees(s.noise_tilt)},
                          {"noise_heading_deg", geo::degrees(s.noise_heading)}};
    for (int i = 0; i < 3; ++i) {
      camera["boresight_deg"].push_back(geo::degrees(s.shared.boresight[i]));
      camera["boresight_sigma_deg"].push_back(geo::degrees(s.sigmas.boresight[i]));
      camera["lever_m"].push_back(s.shared.lever_m[i]);
      camera["lever_sigma_m"].push_back(s.sigmas.lever_m[i]);
    }
    for (int i = 0; i < tiling::adjust::Lens::kSize; ++i)
      camera["lens"][tiling::adjust::Lens::kNames[static_cast<std::size_t>(i)]] = {
          {"value", s.shared.lens[i]}, {"sigma", s.sigmas.lens[i]}};
    for (const auto& point : c.control) {
      nlohmann::json control{{"name", point.name}, {"check", point.check}};
      if (point.residual_m)
        control["residual_enu_m"] = {point.residual_m->x(), point.residual_m->y(), point.residual_m->z()};
      camera["control"].push_back(std::move(control));
    }
    out["cameras"].push_back(std::move(camera));
  }
  return out;
}

void print(const FlightAdjustment& result, const capture::Flight& flight) {
  for (const auto& c : result.cameras) {
    const auto& s = c.summary;
    fmt::print("camera {}: {} of {} frames adjusted, {} points, {} measurements, {:.2f} px\n", c.camera_id,
               s.adjusted, s.frames, s.points, s.observations, s.rms_px);
    fmt::print(
        "  focal length {:.2f} +- {:.2f} px (nominal {:.2f}), principal point {:.2f}, {:.2f} +- {:.2f}, "
        "{:.2f}\n",
        s.shared.lens[0], s.sigmas.lens[0], c.nominal.fx, s.shared.lens[1], s.shared.lens[2],
        s.sigmas.lens[1], s.sigmas.lens[2]);
    fmt::print(
        "  telemetry: late by {:.2f} +- {:.2f} s, noise {:.2f} m across, {:.2f} m up, {:.2f} deg tilt, "
        "{:.2f} deg heading\n",
        s.shared.delay_s, s.sigmas.delay_s, s.noise_horizontal_m, s.noise_vertical_m,
        geo::degrees(s.noise_tilt), geo::degrees(s.noise_heading));
    if (s.dome.sigma_m > 0)
      fmt::print("  ground: its bend (a dome) is known to +- {:.3f} m\n", s.dome.sigma_m);
    for (const auto& point : c.control) {
      if (point.residual_m)
        fmt::print("  {} {}: {:+.3f} {:+.3f} {:+.3f} m (east, north, up)\n",
                   point.check ? "check" : "control", point.name, point.residual_m->x(),
                   point.residual_m->y(), point.residual_m->z());
      else
        fmt::print("  {} {}: not seen by two adjusted frames\n", point.check ? "check" : "control",
                   point.name);
    }
  }
  std::map<std::string, int> assumed;
  for (const auto& f : result.frames) {
    if (!f.assumed.empty()) ++assumed[f.assumed];
    if (f.pose.state != FrameState::Adjusted)
      fmt::print("{}: {}: {}\n", flight.at(f.index).frame.name, nameOf(f.pose.state), f.pose.reason);
  }
  for (const auto& [what, count] : assumed) fmt::print("assumed for {} frames: {}\n", count, what);
}

Result<int> adjust(const Arguments& arguments, const Context& context) {
  capture::ImportOptions import;
  import.raw = true;
  if (!arguments.camera.empty()) import.camera_file = arguments.camera;
  const auto flight = capture::importFlight(arguments.flight, import);
  if (!flight) return tl::unexpected(flight.error());
  tiling::adjust::FlightAdjustOptions options;
  if (!arguments.control.empty()) {
    auto control = tiling::adjust::readControlFile(arguments.control);
    if (!control) return tl::unexpected(control.error());
    options.control = std::move(*control);
  }
  Progress progress("adjusting frames", flight->size());
  options.progress = [&](std::size_t done, const std::string& name) { progress.update(done, name); };
  const auto result = tiling::adjust::adjustFlight(*flight, options);
  if (!result) return tl::unexpected(result.error());
  progress.finish();
  if (!arguments.out.empty()) {
    const auto saved = capture::saveFlight(result->flight, arguments.out);
    if (!saved) return tl::unexpected(saved.error());
  }
  if (context.json)
    fmt::print("{}\n", asJson(*result, *flight).dump(2));
  else
    print(*result, *flight);
  int adjusted = 0;
  for (const auto& f : result->frames) adjusted += f.pose.state == FrameState::Adjusted ? 1 : 0;
  return adjusted > 0 ? kOk : kFailed;
}

void build(CLI::App& command, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  command.add_option("FLIGHT", arguments->flight, "folder of a flight, of any kind that can be imported")
      ->required();
  command.add_option("-o,--output", arguments->out,
                     "new folder for the flight with adjusted poses and camera");
  command.add_option("--camera", arguments->camera, "camera file to begin from instead of the flight's");
  command.add_option("--control", arguments->control,
                     "ground control and check points: ODM's gcp_list.txt or a CSV (see docs/adjustment.md)");
  context.onRun(command, [arguments, &context] { return adjust(*arguments, context); });
}

const Registered registered{"adjust", "adjusts the poses and the lens of a whole flight by its pictures",
                            build};

}  // namespace
}  // namespace overfly::cli
