#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <optional>

#include "capture/geo/footprint.h"
#include "capture/record/recorder.h"
#include "daemon/cli/command.h"
#include "daemon/cli/progress.h"
#include "render/scene/renderer.h"
#include "render/scene/scene_source.h"

namespace overfly::cli {
namespace {

struct Options {
  std::string scene;
  std::string record;
  bool explain = false;
  int frames = 0;  // 0: all
};

Result<std::shared_ptr<const scene::World>> load(const Options& options) {
  Result<scene::SceneDescription> description = scene::loadScene(options.scene);
  if (!description) return tl::unexpected<Error>(description.error());
  if (options.frames > 0) {
    description->path.frames = std::min(description->path.frames, options.frames);
    description->path.lines = std::min(description->path.lines, description->path.frames);
  }
  return scene::buildWorld(*description);
}

// The compiled graph, with what each pass costs on this machine: the mean of a few frames.
Result<int> explain(const std::shared_ptr<const scene::World>& world) {
  Result<gl::Context> context = gl::Context::create();
  if (!context) return tl::unexpected<Error>(context.error());
  Result<std::unique_ptr<scene::Renderer>> renderer = scene::Renderer::create(*context, world);
  if (!renderer) return tl::unexpected<Error>(renderer.error());
  (*renderer)->measure(true);
  constexpr int kWarmUp = 1, kMeasured = 3;
  std::map<std::string, double> milliseconds;
  const int frames = (*renderer)->path().frames();
  for (int i = 0; i < kWarmUp + kMeasured; ++i) {
    const Result<scene::Picture> picture = (*renderer)->render(i * frames / (kWarmUp + kMeasured));
    if (!picture) return tl::unexpected<Error>(picture.error());
    if (i < kWarmUp) continue;
    for (const scene::FrameCost::Pass& pass : (*renderer)->lastCost().passes) {
      milliseconds[pass.name] += pass.milliseconds / kMeasured;
    }
  }
  const scene::SceneDescription& description = world->description;
  fmt::print("scene {}: {}x{}, {} frames in {:.1f} s, GSD {:.1f} cm\n", description.name,
             description.camera.width, description.camera.height, frames, (*renderer)->path().duration(),
             100 * (*renderer)->path().gsd());
  fmt::print("on {}\n\n{:<18} {:<24} {:>9}  {}\n", context->info().renderer, "node", "kind", "ms/frame",
             "what");
  for (const scene::GraphNode& node : scene::compileGraph(description.effects)) {
    const auto cost = milliseconds.find(node.name);
    fmt::print("{:<18} {:<24} {:>9}  {}\n", node.name, scene::nameOf(node.kind),
               cost == milliseconds.end() ? "-" : fmt::format("{:.1f}", cost->second), node.meaning);
  }
  const scene::FrameCost& cost = (*renderer)->lastCost();
  fmt::print("\nlast frame: {} passes, {} draws, {} triangles, {} plants\n", cost.passes.size(), cost.draws,
             cost.triangles, cost.plants);
  return kOk;
}

// truth.csv: the exact pose of each recorded frame, beside what the flight says.
Result<void> writeTruth(const std::filesystem::path& folder, const scene::FlightPlan& plan,
                        std::int64_t start_ns) {
  std::ofstream file(folder / "truth.csv");
  file << "sequence,time_ns,lat_deg,lon_deg,height_m,ecef_x,ecef_y,ecef_z,qw,qx,qy,qz\n";
  for (const scene::PlannedFrame& frame : plan.frames) {
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
std::optional<capture::RawTelemetry> rawOf(const capture::Frame& frame) {
  if (frame.pose_is_adjusted || !frame.pose) return std::nullopt;
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
  return raw;
}

Result<int> record(const Options& options, const std::shared_ptr<const scene::World>& world) {
  scene::SceneSource source(world, {.speed = 0});
  if (const Result<void> opened = source.open(); !opened) return tl::unexpected<Error>(opened.error());
  capture::FlightInfo info;
  info.made_by = "overfly simulate";
  info.source = source.describe();
  info.datum = capture::VerticalDatum::Ellipsoid;
  info.datum_reason = "the scene's place is given on the ellipsoid";
  info.origin = world->description.place;
  info.ground_height_m = world->description.place.height_m + world->description.path.ground;
  info.ground_reason = "path.ground of the scene";
  info.boot_id = "simulated";
  Result<capture::FlightRecorder> recorder = capture::FlightRecorder::create(options.record, info);
  if (!recorder) return tl::unexpected<Error>(recorder.error());
  const std::size_t total = source.plan().frames.size();
  Progress progress("rendering frames", total);
  for (std::size_t done = 0; done < total;) {
    Result<capture::FramePtr> frame = source.next(std::chrono::seconds(10));
    if (!frame && frame.error().code == ErrorCode::Unavailable && done > 0) continue;  // slow machine
    if (!frame) return tl::unexpected<Error>(frame.error());
    if (!*frame) break;
    if (const Result<void> written = recorder->record(**frame, rawOf(**frame)); !written) {
      return tl::unexpected<Error>(written.error());
    }
    progress.update(++done, (*frame)->name);
  }
  progress.finish();
  if (const Result<void> closed = recorder->close(); !closed) return tl::unexpected<Error>(closed.error());
  if (const Result<void> written = writeTruth(options.record, source.plan(), scene::kFlightStart_ns);
      !written) {
    return tl::unexpected<Error>(written.error());
  }
  fmt::print("{}: {} frames of {}, exact poses in truth.csv\n", options.record, total,
             world->description.name);
  return kOk;
}

Result<int> simulate(const Options& options) {
  const Result<std::shared_ptr<const scene::World>> world = load(options);
  if (!world) return tl::unexpected<Error>(world.error());
  if (options.explain) {
    Result<int> explained = explain(*world);
    if (!explained || options.record.empty()) return explained;
  }
  if (!options.record.empty()) return record(options, *world);
  return fail(ErrorCode::BadSettings, "simulate needs --record DIR, or --explain");
}

void build(CLI::App& command, Context& context) {
  auto options = std::make_shared<Options>();
  command
      .add_option("SCENE", options->scene, "scene file, or the name of one that ships: village, city, ...")
      ->required();
  command.add_option("--record", options->record, "folder to write a recorded flight to");
  command.add_flag("--explain", options->explain,
                   "print what the scene's effects compile to, with the cost of each pass");
  command.add_option("--frames", options->frames, "only the first so many frames")
      ->check(CLI::PositiveNumber);
  context.onRun(command, [options] { return simulate(*options); });
}

const Registered registered{"simulate", "makes a flight whose every height and colour is known", build};

}  // namespace
}  // namespace overfly::cli
