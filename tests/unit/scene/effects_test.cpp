// Each effect against its physics.
#include <gtest/gtest.h>

#include <complex>
#include <numbers>
#include <opencv2/calib3d.hpp>

#include "render/scene/flight_plan.h"
#include "render/scene/gauss_markov.h"
#include "tests/unit/scene/scene_fixture.h"

namespace overfly::scene {
namespace {

// A white-topped mast on dark water: one bright spot whose place and length can be measured. The same water
// without it is what the measurements subtract.
const std::string kWater = "base = \"water\"\n[terrain]\nextent = [160, 160]\n";
const std::string kMast =
    "[[building]]\nat = [0, 0]\nsize = [0.9, 0.9]\nheight = 0.5\nwall = \"concrete\"\nroof = \"concrete\"\n";

struct Blob {
  Eigen::Vector2d centre{0, 0};
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();  // second moments, pixels^2
};

// Moments of the light that the mast adds.
Blob blobOf(const std::string& effects, const std::string& camera, const CameraState& state,
            const CameraMotion& motion = {}) {
  const std::string top = effects.empty() ? "" : effects + "\n";
  const Picture with = Stage(top + kWater + kMast + camera).render(state, motion);
  const Picture without = Stage(top + kWater + camera).render(state, motion);
  Blob blob;
  double sum = 0;
  Eigen::Matrix2d second = Eigen::Matrix2d::Zero();
  for (int y = 0; y < with.height; ++y) {
    for (int x = 0; x < with.width; ++x) {
      const double light = linearAt(with, x, y) - linearAt(without, x, y);
      const Eigen::Vector2d p(x + 0.5, y + 0.5);
      sum += light;
      blob.centre += light * p;
      second += light * p * p.transpose();
    }
  }
  blob.centre /= sum;
  blob.spread = second / sum - blob.centre * blob.centre.transpose();
  return blob;
}

TEST(Effects, NoiseVarianceGrowsWithGainAsElectronsSay) {
  for (const double gain : {2.0, 8.0, 32.0}) {
    const std::string toml = "base = \"yard\"\n[terrain]\nextent = [900, 900]\nspacing = 10\n" + kSmallCamera;
    // From so high that the ground's texture is filtered away but for its coarsest part: compare with the
    // frame without noise, pixel by pixel.
    Stage quiet(toml),
        noisy("effects = [\"sensor_noise\"]\n[effect.sensor_noise]\ngain = " + std::to_string(gain) + "\n" +
              toml);
    const CameraState state = lookingDown(0, 0, 300);
    const Picture clean = quiet.render(state);
    double variance = 0, expected = 0;
    for (int frame = 0; frame < 3; ++frame) {
      const Picture picture = noisy.render(state, {}, 0, frame);
      for (int y = 0; y < picture.height; ++y) {
        for (int x = 0; x < picture.width; ++x) {
          const double signal = linearAt(clean, x, y), error = linearAt(picture, x, y) - signal;
          const double white = 9000 / gain;
          variance += error * error;
          // Shot noise, read noise, and the rounding to eight bits of either picture (in linear light).
          expected += signal / white + 9 / (white * white) + 2 * signal * 4 / (12 * 255.0 * 255.0);
        }
      }
    }
    EXPECT_NEAR(variance / expected, 1, 0.03) << "gain " << gain;
  }
}

TEST(Effects, NoiseIsTheSameWhetherOrNotOthersAreNamed) {
  const std::string rest = "base = \"yard\"\n[terrain]\nextent = [200, 200]\n" + kSmallCamera;
  Stage one("effects = [\"sensor_noise\"]\n" + rest),
      two("effects = [\"gnss_noise\", \"sensor_noise\", \"motion_blur\"]\n" + rest);
  const CameraState state = lookingDown(0, 0, 40);  // at rest: the blur does nothing
  EXPECT_GT(agreement(one.render(state), two.render(state), 1), 0.999);
}

TEST(Effects, BlurIsSpeedTimesExposureOverGsd) {
  const std::string camera = "[camera]\nwidth = 320\nheight = 240\nfx = 400\n";
  const CameraState state = lookingDown(0, 0, 40.5);  // 10 pixels a metre on the mast's top
  CameraMotion motion;
  motion.velocity = {24, 0, 0};
  const Blob still = blobOf("", camera, state, motion);
  const Blob moved =
      blobOf("effects = [\"motion_blur\"]\n[effect.motion_blur]\nexposure_ms = 25", camera, state, motion);
  const double length = 24 * 0.025 * 10;  // pixels
  EXPECT_NEAR(std::sqrt(12 * (moved.spread(0, 0) - still.spread(0, 0))), length, 0.3);
  EXPECT_NEAR(moved.spread(1, 1), still.spread(1, 1), 0.2);
  EXPECT_NEAR((moved.centre - still.centre).norm(), 0, 0.05);
}

TEST(Effects, RollingShutterShearsByLineTimeTimesSpeed) {
  const std::string camera = "[camera]\nwidth = 320\nheight = 240\nfx = 400\n";
  CameraMotion motion;
  motion.velocity = {20, 0, 0};
  for (const double north : {-8.0, 0.0, 8.0}) {
    const CameraState state = lookingDown(0, north, 40.5);
    const Blob still = blobOf("", camera, state, motion);
    const Blob moved = blobOf("effects = [\"rolling_shutter\"]\n[effect.rolling_shutter]\nline_time_us = 100",
                              camera, state, motion);
    const double rows = still.centre.y() - 120;  // after the middle row
    EXPECT_NEAR(moved.centre.x() - still.centre.x(), -20 * rows * 100e-6 * 10, 0.03) << north;
    EXPECT_NEAR(moved.centre.y(), still.centre.y(), 0.03);
  }
}

TEST(Effects, RollingShutterAgreesWithRaysFromEachRowsPose) {
  const std::string toml =
      "effects = [\"rolling_shutter\"]\n[effect.rolling_shutter]\nline_time_us = 80\n[terrain]\nkind = "
      "\"fractal\"\nextent = [120, 120]\n"
      "[[building]]\nat = [4, 3]\nheight = 8\n[path]\nheight = 40\nspeed = 15\nframes = 3\nlines = "
      "1\nsway_deg = 6\n" +
      kSmallCamera;
  Stage stage(toml);
  const Geometry geometry(*stage.world);
  TraceOptions options;
  options.line_time_s = 80e-6;
  const FlightPath& path = stage.renderer->path();
  EXPECT_GT(agreement(stage.render(1),
                      tracePicture(geometry, stage.renderer->camera(), path, path.timeOf(1), options), 3),
            0.93);
}

TEST(Effects, DistortionIsOpenCvs) {
  const std::string camera = "[camera]\nwidth = 400\nheight = 300\nfx = 300\n";
  const std::string effects =
      "effects = [\"lens_distortion\"]\n[effect.lens_distortion]\nk1 = -0.2\nk2 = 0.05\np1 = 0.002\np2 = "
      "-0.001\nk3 = 0.01";
  const cv::Mat matrix = (cv::Mat_<double>(3, 3) << 300, 0, 199.5, 0, 300, 149.5, 0, 0, 1);
  const cv::Mat distortion = (cv::Mat_<double>(1, 5) << -0.2, 0.05, 0.002, -0.001, 0.01);
  for (const auto& [east, north] : {std::pair(0.0, 0.0), std::pair(14.0, 10.0), std::pair(-16.0, 9.0),
                                    std::pair(15.0, -11.0), std::pair(0.0, 12.0)}) {
    const CameraState state = lookingDown(east, north, 30.5);
    // The mast's light is not even: what an ideal lens makes of it is where the distortion starts from.
    const Blob ideal = blobOf("", camera, state), blob = blobOf(effects, camera, state);
    std::vector<cv::Point2d> pixels;
    cv::projectPoints(
        std::vector<cv::Point3d>{{(ideal.centre.x() - 200) / 300, (ideal.centre.y() - 150) / 300, 1}},
        cv::Vec3d(0, 0, 0), cv::Vec3d(0, 0, 0), matrix, distortion, pixels);
    EXPECT_NEAR(blob.centre.x(), pixels[0].x + 0.5, 0.06) << east << " " << north;
    EXPECT_NEAR(blob.centre.y(), pixels[0].y + 0.5, 0.06) << east << " " << north;
  }
}

TEST(Effects, ShadowLiesWhereTheSunsAngleSays) {
  Stage stage(
      "effects = [\"sun_shadows\"]\nbase = \"gravel\"\n[terrain]\nextent = [120, 120]\n[[building]]\nat = "
      "[0, 0]\nsize = [3, 3]\nheight = 10\n"
      "[sun]\nazimuth_deg = 230\nelevation_deg = 35\n[camera]\nwidth = 400\nheight = 400\nfx = 400\n");
  const CameraState state = lookingDown(0, 0, 50);
  const Picture picture = stage.render(state);
  const double length = 10 / std::tan(geo::radians(35));
  const Eigen::Vector2d away(-std::sin(geo::radians(230)), -std::cos(geo::radians(230)));
  const auto lightAt = [&](double along, double across) {
    const Eigen::Vector2d p = along * away + across * Eigen::Vector2d(-away.y(), away.x());
    const Eigen::Vector2d pixel = *stage.renderer->camera().project(state.cameraFromEnu({p.x(), p.y(), 0}));
    return linearAt(picture, static_cast<int>(pixel.x()), static_cast<int>(pixel.y()));
  };
  // The far corner of the roof throws the shadow's tip: the middle of the shadow ends at its length plus what
  // the box reaches along that direction.
  const double reach = 1.5 / std::max(std::abs(away.x()), std::abs(away.y()));
  double shadow_end = 0, lit = 0, dark = 0;
  for (int i = 0; i < 40; ++i) {
    lit += lightAt(19 + 0.05 * i, 0.1 * (i % 5)) / 40;
    dark += lightAt(6 + 0.05 * i, 0.1 * (i % 5)) / 40;
  }
  ASSERT_GT(lit, 2 * dark);
  for (double along = 10; along < 18 && shadow_end == 0; along += 0.05) {
    double mean = 0;  // over a patch, against the gravel's own light and dark
    for (int i = 0; i < 35; ++i) mean += lightAt(along + 0.1 * (i % 7 - 3), 0.1 * (i / 7 - 2)) / 35;
    if (mean > 0.5 * (lit + dark)) shadow_end = along;
  }
  EXPECT_NEAR(shadow_end, length + reach, 0.35);
}

TEST(Effects, VignettingIsCosineToTheFourth) {
  const std::string rest = "base = \"gravel\"\n[terrain]\nextent = [400, 400]\nspacing = 5\n" + kSmallCamera;
  Stage plain(rest), dark("effects = [\"vignetting\"]\n" + rest);
  const CameraState state = lookingDown(0, 0, 80);
  const Picture a = plain.render(state), b = dark.render(state);
  for (const auto& [x, y] : {std::pair(20, 20), std::pair(300, 120), std::pair(160, 120)}) {
    double before = 0, after = 0;
    for (int dy = -8; dy <= 8; ++dy) {
      for (int dx = -8; dx <= 8; ++dx) {
        before += linearAt(a, x + dx, y + dy);
        after += linearAt(b, x + dx, y + dy);
      }
    }
    const double r2 = (std::pow(x + 0.5 - 160, 2) + std::pow(y + 0.5 - 120, 2)) / (240.0 * 240.0);
    EXPECT_NEAR(after / before, std::pow(1 + r2, -2), 0.012);
  }
}

TEST(Effects, HazeLeavesTwoPercentOfContrastAtTheVisibility) {
  const std::string rest = kWater + kMast + kSmallCamera;
  Stage clear(rest), hazy("effects = [\"haze\"]\n[effect.haze]\nvisibility_m = 80\n" + rest);
  const CameraState state = lookingDown(0, 0, 40.5);
  const Picture a = clear.render(state), b = hazy.render(state);
  const double before = linearAt(a, 160, 120) - linearAt(a, 200, 120),
               after = linearAt(b, 160, 120) - linearAt(b, 200, 120);
  EXPECT_NEAR(after / before, std::pow(0.02, 40.0 / 80), 0.02);
}

TEST(Effects, DefocusIsTheCircleOfConfusion) {
  const std::string camera = "[camera]\nwidth = 320\nheight = 240\nfx = 1200\n";
  const CameraState state = lookingDown(0, 0, 40.5);
  const Blob still = blobOf("", camera, state);
  const Blob blurred =
      blobOf("effects = [\"defocus\"]\n[effect.defocus]\nfocus_m = 5\naperture_mm = 40", camera, state);
  const double diameter = 1200 * 0.040 * (1 / 5.0 - 1 / 40.0);  // pixels
  // A uniform disc has a variance of diameter^2 / 16 along each axis.
  EXPECT_NEAR(std::sqrt(16 * (blurred.spread(0, 0) - still.spread(0, 0))), diameter, 0.12 * diameter);
}

// Averaged periodogram of the process against its closed form.
TEST(Effects, GnssNoiseHasTheSpectrumOfItsParameters) {
  const double sigma = 1.2, tau = 4, step = 0.5;
  constexpr int kLength = 256, kRuns = 300;
  std::vector<double> times;
  for (int i = 0; i < kLength; ++i) times.push_back(step * i);
  for (const int bin : {2, 8, 24, 64}) {
    double power = 0;
    for (std::uint32_t run = 0; run < kRuns; ++run) {
      const std::vector<double> x = gaussMarkov(1000 + run, times, sigma, tau);
      std::complex<double> sum = 0;
      for (int i = 0; i < kLength; ++i) {
        const double window =
            1 - std::cos(2 * std::numbers::pi * (i + 0.5) / kLength);  // Hann, mean square 1.5
        sum += window * x[static_cast<std::size_t>(i)] *
               std::polar(1.0, -2 * std::numbers::pi * bin * i / kLength);
      }
      power += std::norm(sum) / (1.5 * kLength) / kRuns;
    }
    // Sampled first-order process: sigma^2 (1 - a^2) / |1 - a e^{-iw}|^2.
    const double a = std::exp(-step / tau), w = 2 * std::numbers::pi * bin / kLength;
    const double expected = sigma * sigma * (1 - a * a) / std::norm(1.0 - a * std::polar(1.0, -w));
    EXPECT_NEAR(power / expected, 1, 0.2) << "bin " << bin;
  }
}

TEST(Effects, PoseEffectsAreWhatTheirParametersSay) {
  const std::string path = "[path]\nframes = 600\nlines = 1\nspeed = 5\nheight = 40\n";
  const auto planOf = [&](const std::string& effects) {
    const auto world = worldOf(effects + path);
    return planFlight(
        *world, FlightPath(world->description.path, world->description.camera, world->description.seed));
  };
  const FlightPlan exact = planOf("effects = [\"sensor_noise\"]\n");
  EXPECT_TRUE(exact.poses_are_exact);
  EXPECT_EQ(exact.frames.size(), 600u);

  const FlightPlan late = planOf("effects = [\"time_delay\"]\n[effect.time_delay]\ndelay_ms = 200\n");
  EXPECT_FALSE(late.poses_are_exact);
  EXPECT_NEAR((late.frames[300].recorded->position_in_ecef - late.frames[300].exact.position_in_ecef).norm(),
              5 * 0.2, 1e-6);

  const FlightPlan mounted = planOf(
      "effects = [\"mounting\"]\n[effect.mounting]\nroll_deg = 0\npitch_deg = 2\nyaw_deg = 0\nforward_m = "
      "0.3\nright_m = 0\ndown_m = 0\n");
  EXPECT_NEAR(
      mounted.frames[5].recorded->ecef_from_camera.angularDistance(mounted.frames[5].exact.ecef_from_camera),
      geo::radians(2), 1e-9);
  EXPECT_NEAR(
      (mounted.frames[5].recorded->position_in_ecef - mounted.frames[5].exact.position_in_ecef).norm(), 0.3,
      1e-6);

  const FlightPlan noisy =
      planOf("effects = [\"gnss_noise\"]\n[effect.gnss_noise]\ntime_constant_s = 2\nwhite_m = 0\n");
  const geo::LocalFrame local({geo::radians(47), geo::radians(9), 500});
  Eigen::Vector3d squares = Eigen::Vector3d::Zero();
  for (const PlannedFrame& frame : noisy.frames) {
    squares += (local.enuFromEcef(frame.recorded->position_in_ecef) -
                local.enuFromEcef(frame.exact.position_in_ecef))
                   .cwiseAbs2() /
               600;
  }
  EXPECT_NEAR(std::sqrt(squares.x()), 1.2, 0.25);
  EXPECT_NEAR(std::sqrt(squares.z()), 2.0, 0.4);
  EXPECT_NEAR(noisy.frames[0].recorded->covariance(2, 2), 4, 1e-9);

  const FlightPlan gaps = planOf(
      "effects = [\"dropped_frames\", \"dropped_poses\"]\n[effect.dropped_frames]\ndropped = "
      "0.2\n[effect.dropped_poses]\ndropped = 0.1\nlate = 0\n");
  EXPECT_NEAR(static_cast<double>(gaps.frames.size()), 480, 40);
  const auto lost = std::count_if(gaps.frames.begin(), gaps.frames.end(),
                                  [](const PlannedFrame& f) { return !f.recorded; });
  EXPECT_NEAR(static_cast<double>(lost), 48, 22);
}

TEST(Effects, ExposureDriftScalesLight) {
  const std::string rest =
      "base = \"yard\"\n[terrain]\nextent = [200, 200]\n[path]\nheight = 40\nframes = 8\nlines = 1\n" +
      kSmallCamera;
  Stage plain(rest), drifting(
                         "effects = [\"exposure_drift\"]\n[effect.exposure_drift]\nexposure_stops = "
                         "0.4\nwhite_balance = 0\ntime_constant_s = 1\n" +
                         rest);
  double least = 10, most = 0;
  for (int frame = 0; frame < 4; ++frame) {
    const Picture a = plain.render(frame), b = drifting.render(frame);
    double before[3] = {}, after[3] = {};
    for (int y = 0; y < 240; y += 3) {
      for (int x = 0; x < 320; x += 3) {
        for (int c = 0; c < 3; ++c) {
          before[c] += linearAt(a, x, y, c);
          after[c] += linearAt(b, x, y, c);
        }
      }
    }
    EXPECT_NEAR(after[0] / before[0], after[2] / before[2], 0.01);  // one exposure for all channels
    least = std::min(least, after[1] / before[1]);
    most = std::max(most, after[1] / before[1]);
  }
  EXPECT_GT(most / least, 1.1);
}

TEST(Effects, VehiclesDriveAndAreNoPartOfTheTruth) {
  const std::string rest =
      "[terrain]\nextent = [160, 160]\n[[street]]\npoints = [[-70, 0], [70, 0]]\n" + kSmallCamera;
  const std::string cars = "effects = [\"vehicles\"]\n[effect.vehicles]\nper_kilometre = 60\n";
  Stage empty(rest), busy(cars + rest);
  const CameraState state = lookingDown(0, 0, 60);
  const Picture street = empty.render(state), now = busy.render(state), later = busy.render(state, {}, 0.5);
  EXPECT_LT(agreement(street, now, 8), 0.995);
  EXPECT_LT(agreement(now, later, 8), 0.995);
  EXPECT_EQ(busy.world->solids.indices.size(), 0u);
  EXPECT_EQ(now.rgb, busy.render(state).rgb);
}

TEST(Effects, WindMovesCrownsOnly) {
  const std::string rest =
      "[terrain]\nextent = [120, 120]\n[[vegetation]]\nper_hectare = 100\nheight = [8, 12]\n" + kSmallCamera;
  Stage stage("effects = [\"wind_sway\"]\n[effect.wind_sway]\namplitude_m = 0.5\n" + rest);
  const CameraState state = lookingDown(0, 0, 60);
  const double same = agreement(stage.render(state, {}, 0.3), stage.render(state, {}, 1.1), 2);
  EXPECT_LT(same, 0.95);
  EXPECT_GT(same, 0.2);  // the ground between them
}

TEST(Effects, CloudsMoveAndDarken) {
  const std::string rest = "[terrain]\nextent = [200, 200]\n" + kSmallCamera;
  Stage clear(rest),
      cloudy(
          "effects = [\"cloud_shadows\"]\n[effect.cloud_shadows]\nsize_m = 30\ncover = 0.5\ndepth = 0.5\n" +
          rest);
  const CameraState state = lookingDown(0, 0, 70);
  const Picture a = clear.render(state), b = cloudy.render(state), later = cloudy.render(state, {}, 4);
  int dark = 0, total = 0;
  for (int y = 0; y < a.height; y += 4) {
    for (int x = 0; x < a.width; x += 4, ++total) {
      const double ratio = linearAt(b, x, y) / linearAt(a, x, y);
      EXPECT_GT(ratio, 0.42);
      EXPECT_LT(ratio, 1.08);
      dark += ratio < 0.7 ? 1 : 0;
    }
  }
  EXPECT_GT(dark, total / 8);
  EXPECT_LT(dark, total * 7 / 8);
  EXPECT_LT(agreement(b, later, 4), 0.9);
}

TEST(Effects, WaterGlintsAndOnlyWater) {
  const std::string rest =
      "[terrain]\nextent = [200, 200]\n[sun]\nelevation_deg = 75\nazimuth_deg = 180\n" + kSmallCamera;
  for (const bool water : {true, false}) {
    const std::string base = water ? "base = \"water\"\n" : "base = \"yard\"\n";
    Stage dull(base + rest), bright("effects = [\"specular\"]\n" + base + rest);
    const CameraState state = lookingDown(0, 0, 60);
    const double same = agreement(dull.render(state), bright.render(state), 0);
    if (water) {
      EXPECT_LT(same, 0.9);
      EXPECT_LT(agreement(bright.render(state), bright.render(state, {}, 1.0), 8),
                0.95);  // and never stands still
    } else {
      EXPECT_EQ(same, 1);
    }
  }
}

}  // namespace
}  // namespace overfly::scene
