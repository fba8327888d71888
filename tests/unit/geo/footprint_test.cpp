#include "capture/geo/footprint.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include "tests/unit/geo/globe.h"

namespace overfly::geo {
namespace {

using ::testing::HasSubstr;
using testing::longitudeDeg;
using testing::uniform;

capture::CameraModel camera() {
  capture::CameraModel model;
  model.width = 4000;
  model.height = 3000;
  model.fx = model.fy = 3000;
  model.cx = 2000;
  model.cy = 1500;
  return model;
}

capture::Pose poseAt(const Geodetic& at, double yaw_deg, double pitch_deg, double roll_deg = 0) {
  const LocalFrame local(at);
  capture::Pose pose;
  pose.position_in_ecef = ecefFromGeodetic(at);
  pose.ecef_from_camera = Eigen::Quaterniond(local.enuFromEcefRotation().transpose()) *
                          enuFromCamera(radians(yaw_deg), radians(pitch_deg), radians(roll_deg));
  return pose;
}

double metres(const Geodetic& a, const Geodetic& b) {
  return (ecefFromGeodetic(a) - ecefFromGeodetic(b)).norm();
}

rc::Gen<Geodetic> anywhere() {
  return rc::gen::map(rc::gen::tuple(rc::gen::oneOf(uniform(-90, 90), rc::gen::element(-90.0, 90.0)),
                                     longitudeDeg(), uniform(-500, 9000)),
                      [](const std::tuple<double, double, double>& t) {
                        return Geodetic{radians(std::get<0>(t)), radians(std::get<1>(t)), std::get<2>(t)};
                      });
}

RC_GTEST_PROP(FootprintProperty, straightDownIsThePinholesRectangleAnywhereOnEarth, ()) {
  const Geodetic ground = *anywhere();
  Geodetic at = ground;
  at.height_m += 100;
  const auto print = footprint(camera(), poseAt(at, *uniform(-360, 360), -90), ground.height_m);
  RC_ASSERT(print.has_value());
  RC_ASSERT(std::abs(print->height_above_m - 100) < 1e-6);
  RC_ASSERT(print->tilt < 1e-6);
  RC_ASSERT(std::abs(print->gsd_m - 100.0 / 3000) < 1e-6);
  RC_ASSERT(std::abs(metres(print->corners[0], print->corners[1]) - 400.0 / 3) < 0.01);
  RC_ASSERT(std::abs(metres(print->corners[1], print->corners[2]) - 100) < 0.01);
  for (const Geodetic& corner : print->corners) RC_ASSERT(std::abs(corner.height_m - ground.height_m) < 1e-6);
  RC_ASSERT(metres(print->centre, ground) < 1e-3);
}

// Every footprint that is given lies at the asked height and projects back onto the image's corners.
RC_GTEST_PROP(FootprintProperty, cornersProjectBackOntoTheImage, ()) {
  Geodetic at = *anywhere();
  const double height_m = at.height_m;
  at.height_m += *uniform(1, 3000);
  const auto pose = poseAt(at, *uniform(-180, 180), *uniform(-90, 90), *uniform(-60, 60));
  auto model = camera();
  model.kind = capture::CameraModel::Kind::RadialTangential;
  model.distortion = {-0.05, 0.01, 1e-4, -2e-4, 0};
  const auto print = footprint(model, pose, height_m);
  if (!print) {
    RC_ASSERT(!print.error().message.empty());
    return;
  }
  const Eigen::Vector2d expected[] = {{0, 0}, {4000, 0}, {4000, 3000}, {0, 3000}};
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector3d in_camera =
        pose.ecef_from_camera.conjugate() * (ecefFromGeodetic(print->corners[i]) - pose.position_in_ecef);
    const auto pixel = model.project(in_camera);
    RC_ASSERT(pixel.has_value());
    RC_ASSERT((*pixel - expected[i]).norm() < 0.01);
    RC_ASSERT(std::abs(print->corners[i].height_m - height_m) < 1e-6);
  }
}

TEST(Footprint, ImageTopIsTheHeadingAtNadir) {
  const Geodetic at{radians(48), radians(9), 600};
  const auto east = footprint(camera(), poseAt(at, 90, -90), 500).value();
  EXPECT_GT(east.corners[0].lon, at.lon);  // heading east: both top corners lie east,
  EXPECT_GT(east.corners[1].lon, at.lon);
  EXPECT_GT(east.corners[0].lat, at.lat);  // the left one north
  EXPECT_LT(east.corners[1].lat, at.lat);
}

TEST(Footprint, RefusalsSayWhy) {
  const Geodetic at{radians(48), radians(9), 600};
  const auto reason = [&](double pitch_deg, double height_m) {
    const auto print = footprint(camera(), poseAt(at, 30, pitch_deg), height_m);
    if (print) return std::string("accepted");
    EXPECT_EQ(print.error().code, ErrorCode::BadInput);
    return print.error().message;
  };
  EXPECT_EQ(reason(-90, 500), "accepted");
  EXPECT_EQ(reason(-50, 500), "accepted");
  EXPECT_THAT(reason(-10, 500), HasSubstr("horizon"));
  EXPECT_THAT(reason(0, 500), HasSubstr("horizon"));
  EXPECT_THAT(reason(90, 500), HasSubstr("horizon"));
  EXPECT_THAT(reason(-90, 700), HasSubstr("below"));
  EXPECT_THAT(reason(-90, 600), HasSubstr("below"));
  EXPECT_THAT(reason(-28, 500), HasSubstr("times"));  // the top edge looks 1.4 deg under the horizon
  capture::Pose nan = poseAt(at, 0, -90);
  nan.position_in_ecef.x() = std::nan("");
  EXPECT_FALSE(footprint(camera(), nan, 500));
}

TEST(Footprint, TiltIsTheAngleFromStraightDown) {
  const Geodetic at{radians(-33), radians(179.9999), 1100};
  const auto print = footprint(camera(), poseAt(at, -77, -60), 1000).value();
  EXPECT_NEAR(degrees(print.tilt), 30, 1e-4);
  EXPECT_NEAR(metres(print.centre, {at.lat, at.lon, 1000}), 100 * std::tan(radians(30)), 0.01);
}

TEST(Footprint, RaysMeetTheSurfaceOfConstantHeightFromHighAbove) {
  const Geodetic at{radians(60), radians(-120), 400e3};
  const auto hit = intersectHeight(ecefFromGeodetic(at),
                                   poseAt(at, 45, -30).ecef_from_camera * Eigen::Vector3d::UnitZ(), 8848);
  ASSERT_TRUE(hit);
  EXPECT_NEAR(geodeticFromEcef(*hit).height_m, 8848, 1e-6);
}

RC_GTEST_PROP(ViewPyramidProperty, boxHoldsWhatTheCameraSeesUpToTheDepth, ()) {
  const Geodetic at = *anywhere();
  const auto pose = poseAt(at, *uniform(-180, 180), *uniform(-90, 90), *uniform(-180, 180));
  const double depth_m = *uniform(1, 5000);
  const Box3 box = viewPyramidBox(camera(), pose, depth_m);
  const auto direction = camera().unproject({*uniform(0, 4000), *uniform(0, 3000)});
  const double range_m = *uniform(0, 1) * depth_m / direction->z();
  const Eigen::Vector3d point = pose.position_in_ecef + range_m * (pose.ecef_from_camera * *direction);
  RC_ASSERT((point.array() >= box.min.array() - 1e-6).all() &&
            (point.array() <= box.max.array() + 1e-6).all());
  RC_ASSERT((box.max - box.min).norm() < 4 * depth_m);
}

TEST(ViewPyramid, FisheyeBeyondItsDomainStillHasABox) {
  auto model = camera();
  model.kind = capture::CameraModel::Kind::Fisheye;
  model.fx = model.fy = 1000;  // the corners lie at 2.5 rad from the axis
  model.distortion = {0.1, -0.05, 0, 0};
  const Box3 box = viewPyramidBox(model, poseAt({0.7, 0.2, 500}, 0, -90), 100);
  EXPECT_TRUE(box.min.allFinite() && box.max.allFinite());
  EXPECT_LT((box.max - box.min).maxCoeff(), 2500);
  EXPECT_GT((box.max - box.min).minCoeff(), 50);
}

RC_GTEST_PROP(YawPitchRollProperty, anglesComeBackAsTheSameRotation, ()) {
  const double yaw = radians(*uniform(-180, 180)), roll = radians(*uniform(-180, 180));
  const double pitch =
      radians(*rc::gen::oneOf(uniform(-90, 90), rc::gen::element(-90.0, 90.0, -89.99999999, 0.0)));
  const Eigen::Quaterniond q = enuFromCamera(yaw, pitch, roll);
  const YawPitchRoll back = yawPitchRoll(q);
  RC_ASSERT(q.angularDistance(enuFromCamera(back.yaw, back.pitch, back.roll)) < 1e-7);
}

// A straight-down camera turns smoothly through every yaw: one degree more of yaw is one degree of rotation
// (also where pitch passes beyond the nadir), and the image's top points to the heading.
TEST(YawPitchRoll, NoJumpAtNadirAtAnyYaw) {
  for (int yaw_deg = -360; yaw_deg <= 360; ++yaw_deg) {
    const Eigen::Quaterniond q = enuFromCamera(radians(yaw_deg), radians(-90), 0);
    EXPECT_NEAR(q.angularDistance(enuFromCamera(radians(yaw_deg + 1), radians(-90), 0)), radians(1), 1e-9);
    EXPECT_NEAR(q.angularDistance(enuFromCamera(radians(yaw_deg), radians(-90.5), 0)), radians(0.5), 1e-9);
    const Eigen::Vector3d top = q * -Eigen::Vector3d::UnitY(), view = q * Eigen::Vector3d::UnitZ();
    EXPECT_NEAR((top - Eigen::Vector3d(std::sin(radians(yaw_deg)), std::cos(radians(yaw_deg)), 0)).norm(), 0,
                1e-9);
    EXPECT_NEAR((view + Eigen::Vector3d::UnitZ()).norm(), 0, 1e-9);
    const YawPitchRoll back = yawPitchRoll(q);
    EXPECT_NEAR(std::remainder(back.yaw - radians(yaw_deg), 2 * radians(180)), 0, 1e-7);
    EXPECT_NEAR(back.roll, 0, 1e-7);
  }
}

}  // namespace
}  // namespace overfly::geo
