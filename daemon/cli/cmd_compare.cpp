#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "capture/import/import_flight.h"
#include "daemon/cli/command.h"
#include "daemon/cli/gpu.h"
#include "daemon/cli/progress.h"
#include "tiling/accuracy/aligned_comparison.h"
#include "tiling/adjust/flight_adjust.h"
#include "tiling/adjust/telemetry_prior.h"
#include "tiling/mapping/batch_map.h"
#include "tiling/mapping/mapper_settings.h"

namespace overfly::cli {
namespace {

struct Arguments {
  std::string flight, camera;
  double focal_px = 0;
};

// One set of poses and what came of it.
struct Row {
  std::string poses;
  std::string problem;  // why there is no map; empty when there is
  std::size_t frames = 0;
  double map_s = 0, adjust_s = 0;
  tiling::AlignedComparison result;
  static_assert(tiling::AlignedComparison::kDomeUnit == tiling::adjust::DomeUncertainty::kUnit);
  // What the adjustment states of the bend that its poses leave in the ground; zero where it was not
  // adjusted.
  tiling::adjust::DomeUncertainty stated;
  [[nodiscard]] double cornerSigma() const {  // metres
    return std::sqrt(result.corner_form.dot(stated.covariance * result.corner_form));
  }
  [[nodiscard]] double rmsSigma() const { return std::sqrt((result.rms_form * stated.covariance).trace()); }
};

// The flight with the poses that a device's own words amount to, taken as they are.
capture::Flight withTelemetry(const capture::Flight& recorded) {
  std::vector<capture::FlightFrame> frames = recorded.frames();
  const auto priors = tiling::adjust::priorsFromTelemetry(recorded.frames());
  for (std::size_t i = 0; i < frames.size(); ++i)
    if (priors[i].pose) frames[i].frame.pose = priors[i].pose;
  return {recorded.info(), recorded.cameras(), std::move(frames), recorded.warnings(), recorded.skipped()};
}

// The flight with an ideal lens of that focal length: all that is printed on one.
capture::Flight withNominalLens(const capture::Flight& recorded, double focal_px) {
  const auto ideal = [&](capture::CameraModel camera) {
    camera.kind = capture::CameraModel::Kind::RadialTangential;
    camera.fx = camera.fy = focal_px;
    camera.cx = 0.5 * camera.width;
    camera.cy = 0.5 * camera.height;
    camera.distortion = {0, 0, 0, 0};
    return camera;
  };
  std::vector<capture::FlightCamera> cameras = recorded.cameras();
  for (auto& camera : cameras) camera.model = ideal(camera.model);
  std::vector<capture::FlightFrame> frames = recorded.frames();
  for (auto& frame : frames) frame.frame.camera = ideal(frame.frame.camera);
  return {recorded.info(), std::move(cameras), std::move(frames), recorded.warnings(), recorded.skipped()};
}

// Camera centres of the frames that two versions of a flight both place, by name.
geo::Similarity betweenCentres(const capture::Flight& reference, const capture::Flight& other,
                               const geo::LocalFrame& local) {
  std::map<std::string, Eigen::Vector3d> placed;
  for (const auto& entry : other.frames())
    if (entry.frame.pose) placed[entry.frame.name] = local.enuFromEcef(entry.frame.pose->position_in_ecef);
  std::vector<Eigen::Vector3d> from, to;
  for (const auto& entry : reference.frames()) {
    const auto there = placed.find(entry.frame.name);
    if (!entry.frame.pose || there == placed.end()) continue;
    from.push_back(local.enuFromEcef(entry.frame.pose->position_in_ecef));
    to.push_back(there->second);
  }
  return from.size() < 3 ? geo::Similarity{} : geo::similarityBetween(from, to);
}

void mapAndCompare(gl::Context& context, const tiling::BatchOptions& options, const capture::Flight& flight,
                   const capture::Flight& reference, std::span<const tiling::ReferencePoint> points,
                   double& gsd_m, Row& row) {
  StageProgress progress(row.poses + ": mapping ");
  const auto made = tiling::mapFlightToTiles(context, flight, options, std::ref(progress));
  progress.finish();
  if (!made) {
    row.problem = made.error().message;
    return;
  }
  const auto& [mapped, tiles] = *made;
  if (gsd_m == 0) gsd_m = mapped.ground.gsd_m;
  row.frames = mapped.frames_used;
  row.map_s = mapped.wall_s;
  const geo::LocalFrame local(*reference.info().origin);
  row.result =
      tiling::compareAligned(tiles, mapped.ground.lattice, mapped.ground.base_zoom, mapped.ground.anchor_px,
                             points, local, gsd_m, betweenCentres(reference, flight, local));
}

nlohmann::json asJson(const Row& row, double gsd_m) {
  nlohmann::json out{{"poses", row.poses}, {"frames", row.frames}, {"map_s", row.map_s}};
  if (row.adjust_s > 0) out["adjust_s"] = row.adjust_s;
  if (!row.problem.empty()) {
    out["problem"] = row.problem;
    return out;
  }
  const tiling::AlignedComparison& c = row.result;
  out["gsd_m"] = gsd_m;
  out["fitted_points"] = c.fitted_points;
  for (const auto& [name, s] : {std::pair{"strong", &c.strong}, std::pair{"all", &c.all}})
    out[name] = {{"points", s->points},     {"complete", s->complete},      {"median_gsd", s->median},
                 {"nmad_gsd", s->nmad},     {"rmse_gsd", s->rmse},          {"p99_gsd", s->p99},
                 {"beyond_5", s->beyond_5}, {"beyond_10_gsd", s->beyond_10}};
  out["dome_corner_gsd"] = c.dome_corner;
  out["dome_rms_gsd"] = c.dome_rms;
  if (row.stated.sigma_m > 0) {
    out["dome_corner_sigma_gsd"] = row.cornerSigma() / gsd_m;
    out["dome_rms_sigma_gsd"] = row.rmsSigma() / gsd_m;
  }
  out["scale"] = c.map_from_reference.scale;
  out["turn_deg"] = geo::degrees(Eigen::AngleAxisd(c.map_from_reference.turn).angle());
  out["shift_m"] = c.map_from_reference.shift.norm();
  return out;
}

void print(const std::vector<Row>& rows, double gsd_m) {
  fmt::print(
      "heights after a similarity fitted on half of the points, judged on the other half; 1 GSD = "
      "{:.2f} cm\n\n",
      100 * gsd_m);
  fmt::print("{:<10} {:>6} {:>9} {:>7} {:>8} {:>7} {:>8} {:>11} {:>9} {:>8} {:>7} {:>8}\n", "poses", "frames",
             "complete", "NMAD", "NMAD all", "p99", "> 10", "dome corner", "dome RMS", "scale", "turn",
             "seconds");
  const Row* reference = nullptr;
  for (const Row& row : rows) {
    if (row.poses == "reference" && row.problem.empty()) reference = &row;
    if (!row.problem.empty()) {
      fmt::print("{:<10} no map: {}\n", row.poses, row.problem);
      continue;
    }
    const tiling::AlignedComparison& c = row.result;
    fmt::print(
        "{:<10} {:>6} {:>9.4f} {:>7.3f} {:>8.3f} {:>7.2f} {:>8.4f} {:>11.2f} {:>9.3f} {:>8.4f} "
        "{:>6.2f}\u00b0 {:>8.1f}\n",
        row.poses, row.frames, c.strong.complete, c.strong.nmad, c.all.nmad, c.strong.p99, c.strong.beyond_10,
        c.dome_corner, c.dome_rms, c.map_from_reference.scale,
        geo::degrees(Eigen::AngleAxisd(c.map_from_reference.turn).angle()), row.map_s);
  }
  for (const Row& row : rows)
    if (reference != nullptr && row.poses == "adjusted" && row.problem.empty())
      fmt::print(
          "\nadjusted against reference: NMAD {:.2f} times, complete {:+.2f} points; adjustment {:.1f} s\n",
          row.result.strong.nmad / reference->result.strong.nmad,
          100 * (row.result.strong.complete - reference->result.strong.complete), row.adjust_s);
  for (const Row& row : rows)
    if (row.stated.sigma_m > 0 && row.problem.empty())
      fmt::print("stated by the adjustment (1 sigma): dome corner {:.2f}, dome RMS {:.3f}\n",
                 row.cornerSigma() / gsd_m, row.rmsSigma() / gsd_m);
}

Result<int> compare(const Arguments& arguments, const Context& context) {
  const auto reference = capture::importFlight(arguments.flight);
  if (!reference) return tl::unexpected(reference.error());
  if (!reference->info().origin)
    return fail(ErrorCode::BadInput,
                "the flight has no local origin, so its reference_points.csv cannot be placed");
  auto points = tiling::readReferencePoints(std::filesystem::path(arguments.flight) / "reference_points.csv",
                                            *reference->info().origin);
  if (!points) return tl::unexpected(points.error());
  capture::ImportOptions import;
  import.raw = true;
  if (!arguments.camera.empty()) import.camera_file = arguments.camera;
  auto recorded = capture::importFlight(arguments.flight, import);
  if (!recorded) return tl::unexpected(recorded.error());
  if (arguments.focal_px > 0) recorded = withNominalLens(*recorded, arguments.focal_px);
  auto gl_context = openGpu(context);
  if (!gl_context) return tl::unexpected(gl_context.error());

  const auto loaded = loadSettings(context);
  if (!loaded) return tl::unexpected(loaded.error());
  tiling::BatchOptions mapping;
  mapping.mapper = tiling::mapperOptions(loaded->settings);
  mapping.ground = tiling::groundOptions(loaded->settings);
  double gsd_m = 0;  // the reference's, for all rows
  std::vector<Row> rows(3);
  rows[0].poses = "reference";
  mapAndCompare(*gl_context, mapping, *reference, *reference, *points, gsd_m, rows[0]);
  if (!rows[0].problem.empty())
    return fail(ErrorCode::BadInput, "with the reference poses: " + rows[0].problem);

  rows[1].poses = "adjusted";
  {
    Progress progress("adjusting frames", recorded->size());
    tiling::adjust::FlightAdjustOptions options;
    options.progress = [&](std::size_t done, const std::string& name) { progress.update(done, name); };
    const auto start = std::chrono::steady_clock::now();
    const auto adjusted = tiling::adjust::adjustFlight(*recorded, options);
    rows[1].adjust_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    progress.finish();
    if (!adjusted) {
      rows[1].problem = adjusted.error().message;
    } else {
      if (adjusted->cameras.size() == 1) rows[1].stated = adjusted->cameras.front().summary.dome;
      mapAndCompare(*gl_context, mapping, adjusted->flight, *reference, *points, gsd_m, rows[1]);
    }
  }
  rows[2].poses = "recorded";
  mapAndCompare(*gl_context, mapping, withTelemetry(*recorded), *reference, *points, gsd_m, rows[2]);

  if (context.json) {
    nlohmann::json out{{"flight", arguments.flight}};
    for (const Row& row : rows) out["rows"].push_back(asJson(row, gsd_m));
    fmt::print("{}\n", out.dump(2));
  } else {
    print(rows, gsd_m);
  }
  return rows[1].problem.empty() ? kOk : kFailed;
}

void build(CLI::App& command, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  command
      .add_option(
          "FLIGHT", arguments->flight,
          "folder of a flight with reference poses, what the device recorded, and reference_points.csv")
      ->required();
  CLI::Option* camera =
      command.add_option("--camera", arguments->camera, "camera file to adjust from instead of the flight's");
  command
      .add_option("--focal", arguments->focal_px,
                  "adjust from an ideal lens of this focal length, pixels: the nominal one")
      ->excludes(camera)
      ->check(CLI::PositiveNumber);
  context.onRun(command, [arguments, &context] { return compare(*arguments, context); });
}

const Registered registered{
    "compare", "maps a flight with its reference, adjusted and recorded poses, and compares the heights",
    build};

}  // namespace
}  // namespace overfly::cli
