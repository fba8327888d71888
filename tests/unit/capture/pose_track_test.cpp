#include "capture/pose_track.h"

#include <gtest/gtest.h>

#include <cmath>

namespace overfly::capture {
namespace {

constexpr std::int64_t kMs = 1'000'000;
const Eigen::Vector3d kPlace(4157222.5, 664789.3, 4774952.1);
const Eigen::Vector3d kZero = Eigen::Vector3d::Zero();

Pose pose(std::int64_t time_ns, const Eigen::Vector3d& offset = Eigen::Vector3d::Zero(),
          const Eigen::Quaterniond& q = Eigen::Quaterniond::Identity()) {
  Pose p;
  p.time_ns = time_ns;
  p.position_in_ecef = kPlace + offset;
  p.ecef_from_camera = q;
  p.covariance.diagonal() << 0.01, 0.01, 0.04, 1e-4, 1e-4, 4e-4;
  return p;
}

Eigen::Quaterniond turn(double angle, const Eigen::Vector3d& axis = Eigen::Vector3d(0.3, -0.5, 0.8)) {
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis.normalized()));
}

TEST(PoseTrack, PosesComeBackAtTheirOwnTimes) {
  PoseTrack track;
  for (int i = 0; i < 10; ++i)
    ASSERT_TRUE(track.add(pose(i * 100 * kMs, {1.0 * i, 0.5 * i * i, 0}, turn(0.1 * i))));
  for (int i = 0; i < 10; ++i) {
    const auto at = track.at(i * 100 * kMs);
    ASSERT_TRUE(at);
    EXPECT_EQ(at->position_in_ecef, (kPlace + Eigen::Vector3d(1.0 * i, 0.5 * i * i, 0)));
    EXPECT_LT(at->ecef_from_camera.angularDistance(turn(0.1 * i)), 1e-12);
  }
}

TEST(PoseTrack, EitherSignOfAQuaternionInterpolatesAlike) {
  for (int signs = 0; signs < 4; ++signs) {
    PoseTrack track;
    Eigen::Quaterniond a = turn(0.4), b = turn(1.1);
    if (signs & 1) a.coeffs() *= -1;
    if (signs & 2) b.coeffs() *= -1;
    ASSERT_TRUE(track.add(pose(0, kZero, a)) && track.add(pose(100 * kMs, kZero, b)));
    for (int ms = 0; ms <= 100; ++ms) {
      const auto at = track.at(ms * kMs);
      ASSERT_TRUE(at);
      EXPECT_LT(at->ecef_from_camera.angularDistance(turn(0.4 + 0.7 * ms / 100.0)), 1e-7)
          << signs << " " << ms;
    }
  }
}

TEST(PoseTrack, RotationTakesTheShortArcAcrossNorth) {
  PoseTrack track;
  const double degree = M_PI / 180;
  ASSERT_TRUE(track.add(pose(0, kZero, turn(350 * degree, Eigen::Vector3d::UnitZ()))));
  ASSERT_TRUE(track.add(pose(100 * kMs, kZero, turn(10 * degree, Eigen::Vector3d::UnitZ()))));
  EXPECT_LT(track.at(50 * kMs)->ecef_from_camera.angularDistance(Eigen::Quaterniond::Identity()), 1e-7);
}

TEST(PoseTrack, AParabolaIsFollowedExactlyAtUnevenTimes) {
  PoseTrack track;
  const auto offset = [](double t) { return Eigen::Vector3d(7 * t, -3 + t * t, 0.2 - 1.5 * t * t); };
  for (const int ms : {0, 90, 210, 280, 400}) ASSERT_TRUE(track.add(pose(ms * kMs, offset(ms * 1e-3))));
  for (int ms = 90; ms <= 280; ++ms) {
    EXPECT_LT((track.at(ms * kMs)->position_in_ecef - kPlace - offset(ms * 1e-3)).norm(), 1e-8) << ms;
  }
  // At the ends one neighbour is missing: within what the covariance admits.
  EXPECT_LT((track.at(40 * kMs)->position_in_ecef - kPlace - offset(0.04)).norm(), 0.005);
}

TEST(PoseTrack, OutsideAndAcrossGapsThereIsNoneWithTheReason) {
  PoseTrackOptions options;
  options.max_gap_ns = 300 * kMs;
  PoseTrack track(options);
  EXPECT_EQ(track.at(0).error().code, ErrorCode::NotFound);
  ASSERT_TRUE(track.add(pose(1000 * kMs)) && track.add(pose(1200 * kMs)) && track.add(pose(1501 * kMs)));
  EXPECT_TRUE(track.at(1100 * kMs));
  const auto early = track.at(990 * kMs), gap = track.at(1300 * kMs), late = track.at(1600 * kMs);
  EXPECT_EQ(early.error().code, ErrorCode::NotFound);
  EXPECT_NE(early.error().message.find("0.010 s younger"), std::string::npos);
  EXPECT_EQ(gap.error().code, ErrorCode::NotFound);
  EXPECT_NE(gap.error().message.find("0.301 s apart"), std::string::npos);
  EXPECT_EQ(late.error().code, ErrorCode::Unavailable);
  EXPECT_NE(late.error().message.find("0.099 s older"), std::string::npos);
  EXPECT_TRUE(track.at(1501 * kMs));
}

TEST(PoseTrack, UncertaintyGrowsTowardsTheMiddleAndWithTheGap) {
  const auto middle = [](std::int64_t gap) {
    PoseTrack track;
    EXPECT_TRUE(track.add(pose(0)) && track.add(pose(gap)));
    return track.at(gap / 2)->covariance;
  };
  const auto short_gap = middle(20 * kMs), long_gap = middle(400 * kMs);
  for (Eigen::Index i = 0; i < 6; ++i) EXPECT_GT(long_gap(i, i), short_gap(i, i));
  // sigma = 2 m/s^2 * 0.2 s * 0.2 s / 2
  EXPECT_NEAR(long_gap(0, 0), 0.01 + std::pow(2.0 * 0.2 * 0.2 / 2, 2), 1e-12);
}

TEST(PoseTrack, LeverArmBoresightAndDelayAreApplied) {
  PoseTrack track;
  const Eigen::Quaterniond q = turn(0.9);
  ASSERT_TRUE(track.add(pose(0, {0, 0, 0}, q)) && track.add(pose(100 * kMs, {10, 0, 0}, q)));
  CameraMount mount;
  mount.lever_arm_in_body = {0.1, -0.2, 0.3};
  mount.body_from_camera = turn(0.2, Eigen::Vector3d::UnitX());
  mount.delay_ns = 30 * kMs;
  const auto at = track.at(20 * kMs, mount);
  ASSERT_TRUE(at);
  EXPECT_EQ(at->time_ns, 20 * kMs);
  EXPECT_LT((at->position_in_ecef - kPlace - Eigen::Vector3d(5, 0, 0) - q * mount.lever_arm_in_body).norm(),
            1e-8);
  EXPECT_LT(at->ecef_from_camera.angularDistance(q * mount.body_from_camera), 1e-7);
}

TEST(PoseTrack, ALongArmTurnsAngularIntoPlaceUncertainty) {
  PoseTrack track;
  ASSERT_TRUE(track.add(pose(0)));
  CameraMount mount;
  mount.lever_arm_in_body = {0, 0, 2};
  const Eigen::Matrix<double, 6, 6> with = track.at(0, mount)->covariance, without = track.at(0)->covariance;
  // The trace grows by at most |arm|^2 times the two largest angular variances, at least by the two smallest.
  const double grown = with.topLeftCorner<3, 3>().trace() - without.topLeftCorner<3, 3>().trace();
  EXPECT_GE(grown, 4 * 2e-4 - 1e-12);
  EXPECT_LE(grown, 4 * 5e-4 + 1e-12);
  EXPECT_TRUE(with.isApprox(with.transpose()));
  EXPECT_GT((with.topRightCorner<3, 3>().norm()), 0);
}

TEST(PoseTrack, OldPosesAreForgottenAndLateOnesFindTheirPlace) {
  PoseTrackOptions options;
  options.keep_ns = 1000 * kMs;
  PoseTrack track(options);
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(track.add(pose(i * 100 * kMs)));
  EXPECT_EQ(track.size(), 11u);
  ASSERT_TRUE(track.add(pose(9850 * kMs, {1, 0, 0})));
  EXPECT_EQ(track.at(9850 * kMs)->position_in_ecef, (kPlace + Eigen::Vector3d(1, 0, 0)));
}

TEST(PoseTrack, PosesThatAreNoneAreRefused) {
  PoseTrack track;
  EXPECT_FALSE(track.add(pose(0, {std::nan(""), 0, 0})));
  EXPECT_FALSE(track.add(pose(0, kZero, Eigen::Quaterniond(0, 0, 0, 0))));
  EXPECT_EQ(track.size(), 0u);
}

}  // namespace
}  // namespace overfly::capture
