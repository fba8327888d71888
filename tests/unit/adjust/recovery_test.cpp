#include <fmt/format.h>
#include <gtest/gtest.h>

#include "tests/unit/adjust/simulated_tracks.h"
#include "tiling/adjust/pose_map.h"

// Pose effects put into simulated telemetry come out again, within three of the stated sigmas.
namespace overfly::tiling::adjust {
namespace {

using tests::SimulatedSettings;
using tests::SimulatedTracks;
using tests::TruthMatcher;

struct Result {
  PoseMap::Summary summary;
  int adjusted = 0;
  double position_rms_m = 0, rotation_rms = 0;  // against truth, radians
  double worst_sigmas = 0;                      // largest pose error in its own stated sigmas
};

Result fly(const SimulatedSettings& settings, SimulatedTracks& tracks) {
  AdjustOptions options;
  PoseMap map(tracks.nominal, options);
  TruthMatcher matcher(settings.wrong_matches);
  for (int i = 0; i < tracks.frames(); ++i) {
    auto picture = tracks.take(i);
    auto pixels = picture.pixels;
    matcher.add(static_cast<FrameId>(i), std::move(picture));
    map.add(static_cast<FrameId>(i), tracks.telemetry(i), std::move(pixels), matcher);
  }
  const auto updates = map.adjustAll(matcher);
  Result out;
  out.summary = map.summary();
  for (const auto& u : updates) {
    if (u.state != FrameState::Adjusted) continue;
    ++out.adjusted;
    const auto truth = tracks.at(tracks.time(static_cast<int>(u.id)));
    Eigen::Matrix<double, 6, 1> e;
    e << u.position - truth.position, rotationVector(u.enu_from_camera * truth.enu_from_camera.conjugate());
    out.position_rms_m += e.head<3>().squaredNorm();
    out.rotation_rms += e.tail<3>().squaredNorm();
    for (int k = 0; k < 6; ++k)
      out.worst_sigmas = std::max(out.worst_sigmas, std::abs(e[k]) / std::sqrt(u.covariance(k, k)));
  }
  out.position_rms_m = std::sqrt(out.position_rms_m / out.adjusted);
  out.rotation_rms = std::sqrt(out.rotation_rms / out.adjusted);
  const auto& s = out.summary;
  fmt::print("{} adjusted, rms {:.3f} px, position {:.3f} m, rotation {:.4f} deg, worst {:.2f} sigma\n",
             out.adjusted, s.rms_px, out.position_rms_m, out.rotation_rms * 57.3, out.worst_sigmas);
  fmt::print(
      "  f {:.2f} +- {:.2f} (true {:.2f}), c {:.2f} {:.2f} +- {:.2f} {:.2f}, d {:.4f} {:.4f} +- {:.4f} "
      "{:.4f}\n",
      s.shared.lens[0], s.sigmas.lens[0], tracks.camera.fx, s.shared.lens[1], s.shared.lens[2],
      s.sigmas.lens[1], s.sigmas.lens[2], s.shared.lens[3], s.shared.lens[4], s.sigmas.lens[3],
      s.sigmas.lens[4]);
  fmt::print(
      "  delay {:.3f} +- {:.3f}, boresight {:.3f} {:.3f} {:.3f} +- {:.3f} {:.3f} {:.3f} deg, noise {:.2f} "
      "{:.2f} m {:.2f} {:.2f} deg\n",
      s.shared.delay_s, s.sigmas.delay_s, s.shared.boresight.x() * 57.3, s.shared.boresight.y() * 57.3,
      s.shared.boresight.z() * 57.3, s.sigmas.boresight.x() * 57.3, s.sigmas.boresight.y() * 57.3,
      s.sigmas.boresight.z() * 57.3, s.noise_horizontal_m, s.noise_vertical_m, s.noise_tilt * 57.3,
      s.noise_heading * 57.3);
  return out;
}

struct Effect {
  const char* name;
  void (*set)(SimulatedSettings&);
};

class Recovery : public testing::TestWithParam<Effect> {};

TEST_P(Recovery, TruthLiesWithinThreeSigma) {
  SimulatedSettings settings;
  settings.points_per_frame = 250;
  GetParam().set(settings);
  SimulatedTracks tracks(settings);
  const Result r = fly(settings, tracks);
  EXPECT_EQ(r.adjusted, tracks.frames());
  EXPECT_LT(r.summary.rms_px, 1.0);
  EXPECT_LT(r.worst_sigmas, 3.5);
  const auto& s = r.summary;
  EXPECT_LT(std::abs(s.shared.lens[0] - tracks.camera.fx), 3 * s.sigmas.lens[0]);
  EXPECT_LT(std::abs(s.shared.lens[1] - tracks.camera.cx), 3 * s.sigmas.lens[1]);
  EXPECT_LT(std::abs(s.shared.lens[2] - tracks.camera.cy), 3 * s.sigmas.lens[2]);
  for (int k = 0; k < 4; ++k)
    EXPECT_LT(std::abs(s.shared.lens[3 + k] - tracks.camera.distortion[static_cast<std::size_t>(k)]),
              3 * s.sigmas.lens[3 + k])
        << "distortion " << k;
  EXPECT_LT(std::abs(s.shared.delay_s - settings.delay_s), 3 * s.sigmas.delay_s);
  for (int k = 0; k < 3; ++k)
    EXPECT_LT(std::abs(s.shared.boresight[k] - settings.boresight[k]), 3 * s.sigmas.boresight[k])
        << "boresight " << k;
}

INSTANTIATE_TEST_SUITE_P(
    Effects, Recovery,
    testing::Values(Effect{"Nothing", [](SimulatedSettings&) {}},
                    Effect{"GnssNoise", [](SimulatedSettings& s) { s.gnss_noise_m = 3; }},
                    Effect{"AttitudeNoise", [](SimulatedSettings& s) { s.attitude_noise = 0.01745; }},
                    Effect{"Boresight",
                           [](SimulatedSettings& s) {
                             s.boresight = {0.02, -0.025, 0.01};
                           }},
                    Effect{"Delay", [](SimulatedSettings& s) { s.delay_s = 0.06; }},
                    Effect{"Focal", [](SimulatedSettings& s) { s.focal_error = 0.02; }},
                    Effect{"Distortion", [](SimulatedSettings& s) { s.distorted = true; }},
                    Effect{"Everything",
                           [](SimulatedSettings& s) {
                             s.gnss_noise_m = 3;
                             s.attitude_noise = 0.01745;
                             s.boresight = {0.02, -0.025, 0.01};
                             s.delay_s = 0.06;
                             s.focal_error = 0.02;
                             s.distorted = true;
                             s.lever_m = {0.1, -0.05, -0.15};
                           }}),
    [](const auto& effect) { return std::string(effect.param.name); });

}  // namespace
}  // namespace overfly::tiling::adjust
