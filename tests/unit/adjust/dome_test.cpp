#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>

#include "tests/unit/adjust/simulated_tracks.h"
#include "tiling/adjust/pose_map.h"

// A block of parallel legs over flat ground hardly knows whether it is bent: what it says about that is held
// against the truth.
namespace overfly::tiling::adjust {
namespace {

using tests::SimulatedSettings;
using tests::SimulatedTracks;
using tests::TruthMatcher;

constexpr double kRelief_m = 0.3;

struct Bend {
  Eigen::Vector3d
      found;  // of the adjusted ground less the true one: metres per kUnit^2, as in DomeUncertainty
  DomeUncertainty stated;
};

Bend flyAndMeasure(const SimulatedSettings& settings) {
  SimulatedTracks tracks(settings);
  PoseMap map(tracks.nominal, AdjustOptions{});
  TruthMatcher matcher(settings.wrong_matches);
  for (int i = 0; i < tracks.frames(); ++i) {
    auto picture = tracks.take(i);
    auto pixels = picture.pixels;
    matcher.add(static_cast<FrameId>(i), std::move(picture));
    map.add(static_cast<FrameId>(i), tracks.telemetry(i), std::move(pixels), matcher);
  }
  map.adjustAll(matcher);
  const std::vector<Eigen::Vector3d> points = map.points(3);
  const auto n = static_cast<Eigen::Index>(points.size());
  Eigen::MatrixXd form(n, 6);
  Eigen::VectorXd errors(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector3d& p = points[static_cast<std::size_t>(i)];
    const Eigen::Vector2d u = p.head<2>() / DomeUncertainty::kUnit;
    form.row(i) << 1, u.x(), u.y(), u.x() * u.x(), u.x() * u.y(), u.y() * u.y();
    errors[i] = p.z() - SimulatedTracks::ground(p.x(), p.y(), kRelief_m);
  }
  return {form.colPivHouseholderQr().solve(errors).tail<3>(), map.summary().dome};
}

TEST(Dome, TheStatedUncertaintyCoversTheTrueBend) {
  SimulatedSettings settings;
  settings.points_per_frame = 60;
  settings.legs = 3;
  settings.frames_per_leg = 8;
  settings.height_m = 40;
  settings.relief_m = kRelief_m;
  settings.spacing_m = 18;
  settings.speed_mps = 5;
  settings.wobble = 0.002;
  settings.gnss_noise_m = 0.3;
  settings.attitude_noise = 0.01;
  settings.distorted = true;
  double squares = 0;
  constexpr int kFlights = 8;
  for (std::uint32_t seed = 1; seed <= kFlights; ++seed) {
    settings.seed = seed;
    const Bend bend = flyAndMeasure(settings);
    ASSERT_GT(bend.stated.sigma_m, 0);
    // In stated sigmas: squared, its mean over flights is 3 where the statement is right.
    const double square = bend.found.dot(bend.stated.covariance.inverse() * bend.found);
    fmt::print("seed {}: bend {:+.3f} {:+.3f} {:+.3f} +- {:.3f} {:.3f} {:.3f} m per (100 m)^2, {:.2f}\n",
               seed, bend.found[0], bend.found[1], bend.found[2], std::sqrt(bend.stated.covariance(0, 0)),
               std::sqrt(bend.stated.covariance(1, 1)), std::sqrt(bend.stated.covariance(2, 2)), square);
    squares += square / kFlights;
  }
  EXPECT_LT(squares, 9);
  EXPECT_GT(squares, 0.3);
}

}  // namespace
}  // namespace overfly::tiling::adjust
