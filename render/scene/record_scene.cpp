#include "render/scene/record_scene.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <fstream>
#include <optional>

#include "capture/geo/footprint.h"
#include "capture/record/recorder.h"
#include "render/scene/renderer.h"
#include "render/scene/scene_source.h"

namespace overfly::scene {
namespace {

double seconds(std::chrono::steady_clock::duration d) { return std::chrono::duration<double>(d).count(); }

// truth.csv: the exact pose of each recorded frame, beside what the flight says.
Result<void> writeTruth(const std::filesystem::path& folder, const FlightPlan& plan, std::int64_t start_ns) {
  std::ofstream file(folder / "truth.csv");
  file << "sequence,time_ns,lat_deg,lon_deg,height_m,ecef_x,ecef_y,ecef_z,qw,qx,qy,qz\n";
  for (const PlannedFrame& frame : plan.frames) {
    const Eigen::Vector3d& p = frame.exact.position_in_ecef;
    const Eigen::Quaterniond& q = frame.exact.ecef_from_camera;
    const geo::Geodetic place = geo::geodeticFromEcef(p);
    file << fmt::format("{},{},{:.10f},{:.10f},{:.5f},{:.5f},{:.5f},{:.5f},{:.12f},{:.12f},{:.12f},{:.12f}\n",
                        frame.frame, start_ns + std::llround(frame.time_s * 1e9), geo::degrees(place.lat),
                        geo::degrees(place.lon), place.height_m, p.x(), p.y(), p.z(), q.w(), q.x(), q.y(),
                        q.z());
  }
  file.close();
  if (!file) {
    return fail(ErrorCode::Io, fmt::format("{} cannot be written", (folder / "truth.csv").string()));
  }
  return {};
}

// What the drone would have written of a noisy pose, for a later adjustment.
capture::TelemetryPtr rawOf(const capture::Frame& frame) {
  if (frame.pose_is_adjusted || !frame.pose) return nullptr;
  const geo::Geodetic place = geo::geodeticFromEcef(frame.pose->position_in_ecef);
  const geo::LocalFrame local(place);
  const Eigen::Quaterniond enu_from_ecef(local.enuFromEcefRotation());
  const geo::YawPitchRoll angles = geo::yawPitchRoll(enu_from_ecef * frame.pose->ecef_from_camera);
  capture::RawTelemetry raw;
  raw.lat = place.lat;
  raw.lon = place.lon;
  raw.altitude_m = place.height_m;
  raw.gimbal_yaw = angles.yaw;
  raw.gimbal_pitch = angles.pitch;
  raw.gimbal_roll = angles.roll;
  return std::make_shared<const capture::RawTelemetry>(raw);
}

capture::FlightInfo infoOf(const World& world, const std::string& source) {
  capture::FlightInfo info;
  info.made_by = "overfly simulate";
  info.source = source;
  info.datum = capture::VerticalDatum::Ellipsoid;
  info.datum_reason = "the scene's place is given on the ellipsoid";
  info.origin = world.description.place;
  info.ground_height_m = world.description.place.height_m + world.description.path.ground;
  info.ground_reason = "path.ground of the scene";
  return info;
}

}  // namespace

Result<RecordedScene> recordScene(const std::shared_ptr<const World>& world,
                                  const std::filesystem::path& folder, const RecordOptions& options) {
  SceneSource source(world,
                     {.speed = options.live ? 1.0 : 0.0, .live_clock = options.live, .gpu = options.gpu});
  const auto start = std::chrono::steady_clock::now();
  if (const Result<void> opened = source.open(); !opened) return tl::unexpected<Error>(opened.error());
  std::optional<capture::FlightRecorder> recorder;
  if (!folder.empty()) {
    capture::FlightInfo info = infoOf(*world, source.describe());
    if (!options.live) info.boot_id = "simulated";
    Result<capture::FlightRecorder> created = capture::FlightRecorder::create(folder, info);
    if (!created) return tl::unexpected<Error>(created.error());
    recorder.emplace(std::move(*created));
  }
  RecordedScene recorded;
  recorded.plan = source.plan();
  recorded.camera = effectiveCamera(world->description);
  const std::size_t total = recorded.plan.frames.size();
  if (total > 0) recorded.duration_s = recorded.plan.frames.back().time_s;
  std::int64_t start_ns = kFlightStart_ns;
  for (std::size_t done = 0; done < total;) {
    Result<capture::FramePtr> frame = source.next(std::chrono::seconds(10));
    // A slow machine; the first frame waits for the shaders' compilation as well.
    if (!frame && frame.error().code == ErrorCode::Unavailable) continue;
    if (!frame) return tl::unexpected<Error>(frame.error());
    if (!*frame) break;
    const PlannedFrame& planned = recorded.plan.frames[done];
    start_ns = (*frame)->time_ns - std::llround(planned.time_s * 1e9);
    if (options.live) {
      const double at_s = seconds(std::chrono::steady_clock::now() - start);
      recorded.worst_late_s = std::max(recorded.worst_late_s, at_s - planned.time_s - planned.late_s);
    }
    if (recorder)
      if (const Result<void> written = recorder->record(**frame, rawOf(**frame)); !written)
        return tl::unexpected<Error>(written.error());
    ++done;
    if (options.progress) options.progress(done, total, (*frame)->name);
  }
  recorded.wall_s = seconds(std::chrono::steady_clock::now() - start);
  if (!recorder) return recorded;
  if (const Result<void> closed = recorder->close(); !closed) return tl::unexpected<Error>(closed.error());
  if (const Result<void> written = writeTruth(folder, recorded.plan, start_ns); !written)
    return tl::unexpected<Error>(written.error());
  return recorded;
}

}  // namespace overfly::scene
