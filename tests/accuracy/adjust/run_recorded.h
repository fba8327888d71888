#pragma once
#include <fmt/format.h>

#include <chrono>
#include <cstdlib>
#include <stdexcept>

#include "tests/accuracy/adjust/against_reference.h"
#include "tests/accuracy/adjust/recorded.h"
#include "tests/accuracy/adjust/retriangulated.h"
#include "tiling/adjust/adjuster.h"
#include "tiling/adjust/telemetry_prior.h"

namespace overfly::tiling::adjust {

using tests::RecordedFlight;

struct Outcome {
  int adjusted = 0;
  PoseMap::Summary summary;
  double position_rms_m = 0;  // after a similarity
  double worst_position_m = 0;
  double rotation_rms_deg = 0;     // after the similarity's turn
  double live_s = 0, total_s = 0;  // wall time: frame by frame, and with the final adjustment
  double raw_position_rms_m = 0, raw_rotation_rms_deg = 0;  // the telemetry, the same way
  geo::Similarity similarity;
  tests::Retriangulated ground;
};

inline Outcome run(const RecordedFlight& flight, const capture::CameraModel& camera, bool verbose,
                   AdjusterOptions options = {}) {
  options.map.retained_frames = 10000;
  Adjuster adjuster(camera, options);
  const auto priors = priorsFromTelemetry(flight.frames);
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < priors.size(); ++i) {
    const auto image = flight.grey(i);
    const auto updates =
        adjuster.addFrame(i, {image.bytes.data(), image.width, image.height, image.stride}, *priors[i].pose);
    if (!updates) throw std::runtime_error(updates.error().message);
    if (verbose)
      for (const auto& u : *updates)
        fmt::print("  {} rev {} state {} shift {:.1f} px, {} obs, rms {:.2f} {}\n", u.id, u.revision,
                   static_cast<int>(u.state), u.shift_px, u.observations, u.rms_px, u.reason);
  }
  const double live = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const auto final = adjuster.adjustAll();
  const double total = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  Outcome out;
  out.summary = adjuster.summary();
  out.live_s = live;
  out.total_s = total;
  const geo::LocalFrame local(flight.origin);
  std::vector<Eigen::Vector3d> got, wanted, raw;
  std::vector<Eigen::Quaterniond> got_q, wanted_q, raw_q;
  std::vector<std::optional<View>> views(flight.frames.size());
  for (const auto& a : final) {
    if (a.state != FrameState::Adjusted) {
      fmt::print("  {} not adjusted: {}\n", flight.frames[a.id].frame.name, a.reason);
      continue;
    }
    ++out.adjusted;
    const Eigen::Quaterniond turn(local.enuFromEcefRotation());
    got.push_back(local.enuFromEcef(a.pose.position_in_ecef));
    got_q.push_back(turn * a.pose.ecef_from_camera);
    views[a.id] = View{got.back(), got_q.back()};
    raw.push_back(local.enuFromEcef(priors[a.id].pose->position_in_ecef));
    raw_q.push_back(turn * priors[a.id].pose->ecef_from_camera);
    wanted.push_back(flight.reference[a.id].position);
    wanted_q.push_back(flight.reference[a.id].enu_from_camera);
    if (verbose)
      fmt::print("  {} obs {} rms {:.2f} sigma {:.2f} {:.2f} {:.2f} m {:.2f} {:.2f} {:.2f} deg\n", a.id,
                 a.observations, a.rms_px, std::sqrt(a.pose.covariance(0, 0)),
                 std::sqrt(a.pose.covariance(1, 1)), std::sqrt(a.pose.covariance(2, 2)),
                 57.3 * std::sqrt(a.pose.covariance(3, 3)), 57.3 * std::sqrt(a.pose.covariance(4, 4)),
                 57.3 * std::sqrt(a.pose.covariance(5, 5)));
  }
  const auto telemetry = tests::againstReference(raw, raw_q, wanted, wanted_q, verbose);
  out.raw_position_rms_m = telemetry.position_rms_m;
  out.raw_rotation_rms_deg = telemetry.rotation_rms_deg;
  const auto poses = tests::againstReference(got, got_q, wanted, wanted_q, verbose);
  out.position_rms_m = poses.position_rms_m;
  out.worst_position_m = poses.worst_position_m;
  out.rotation_rms_deg = poses.rotation_rms_deg;
  out.similarity = poses.similarity;
  out.ground = tests::retriangulate(flight, adjuster.camera(), views);
  const auto& s = out.summary;
  fmt::print("{} of {} frames, {} points, {} observations, rms {:.3f} px; live {:.2f} s, total {:.2f} s\n",
             out.adjusted, flight.frames.size(), s.points, s.observations, s.rms_px, live, total);
  fmt::print(
      "f {:.2f} +- {:.2f} (reference {:.2f}), c {:.1f} {:.1f} +- {:.1f} {:.1f} (reference {:.1f} {:.1f})\n",
      s.shared.lens[0], s.sigmas.lens[0], flight.reference_camera.fx, s.shared.lens[1], s.shared.lens[2],
      s.sigmas.lens[1], s.sigmas.lens[2], flight.reference_camera.cx, flight.reference_camera.cy);
  fmt::print("distortion {:.4f} {:.4f} {:.5f} {:.5f} +- {:.4f} {:.4f} {:.5f} {:.5f}\n", s.shared.lens[3],
             s.shared.lens[4], s.shared.lens[5], s.shared.lens[6], s.sigmas.lens[3], s.sigmas.lens[4],
             s.sigmas.lens[5], s.sigmas.lens[6]);
  fmt::print(
      "delay {:.2f} +- {:.2f} s, boresight {:.2f} {:.2f} {:.2f} deg, lever {:.2f} {:.2f} {:.2f}, noise "
      "{:.2f} {:.2f} m {:.2f} {:.2f} deg, ground {:.2f}\n",
      s.shared.delay_s, s.sigmas.delay_s, s.shared.boresight.x() * 57.3, s.shared.boresight.y() * 57.3,
      s.shared.boresight.z() * 57.3, s.shared.lever_m.x(), s.shared.lever_m.y(), s.shared.lever_m.z(),
      s.noise_horizontal_m, s.noise_vertical_m, s.noise_tilt * 57.3, s.noise_heading * 57.3,
      s.ground_height_m);
  fmt::print(
      "against the reference after a similarity: position rms {:.3f} m, worst {:.3f}; rotation {:.3f} deg "
      "(telemetry: {:.3f} m, {:.3f} deg); scale {:.4f}, turn {:.2f} deg, shift at centre {:.2f} m\n",
      out.position_rms_m, out.worst_position_m, out.rotation_rms_deg, out.raw_position_rms_m,
      out.raw_rotation_rms_deg, out.similarity.scale, Eigen::AngleAxisd(out.similarity.turn).angle() * 57.3,
      got.empty() ? 0 : (out.similarity(got[0]) - got[0]).norm());
  fmt::print(
      "the ground by {} points of the reference: they contradict it by {:.3f} px; heights after a similarity "
      "rms {:.4f} m, of it a dome of {:.4f} m (stated: +- {:.4f} m)\n",
      out.ground.points, out.ground.residual_px, out.ground.height_rms_m, out.ground.dome_rms_m,
      s.dome.sigma_m);
  return out;
}

inline bool verbose() { return std::getenv("OVERFLY_VERBOSE") != nullptr; }

}  // namespace overfly::tiling::adjust
