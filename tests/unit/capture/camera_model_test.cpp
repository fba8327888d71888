#include "capture/camera_model.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <random>

namespace overfly::capture {
namespace {

CameraModel camera(CameraModel::Kind kind, std::vector<double> distortion) {
  CameraModel model;
  model.kind = kind;
  model.width = 1600;
  model.height = 1200;
  model.fx = 1195.5;
  model.fy = 1190.25;
  model.cx = 828.9;
  model.cy = 611.7;
  model.distortion = std::move(distortion);
  return model;
}

using Kind = CameraModel::Kind;

struct Case {
  const char* name;
  CameraModel model;
};

std::vector<Case> cases() {
  return {
      {"Pinhole", camera(Kind::Pinhole, {})},
      {"Four", camera(Kind::RadialTangential, {-0.0128, 0.0053, 0.0030, 0.0060})},
      {"FourBarrel", camera(Kind::RadialTangential, {-0.28, 0.09, 0.0004, -0.0003})},
      {"Five", camera(Kind::RadialTangential, {-0.31, 0.14, -0.0011, 0.0007, -0.031})},
      {"FiveFolds", camera(Kind::RadialTangential, {-0.35, 0.02, 0.0005, 0.0004, 0.0})},
      {"Eight", camera(Kind::RadialTangential, {0.42, -0.21, 0.0006, -0.0002, -0.03, 0.75, -0.15, -0.04})},
      {"EightLarge", camera(Kind::RadialTangential, {12.1, 8.4, 0.0001, 0.0002, 0.6, 12.4, 13.1, 2.9})},
      {"Fisheye", camera(Kind::Fisheye, {-0.021, 0.0093, -0.0071, 0.0011})},
      {"FisheyeFolds", camera(Kind::Fisheye, {-0.11, -0.02, 0.004, -0.001})},
  };
}

class CameraModelEveryKind : public testing::TestWithParam<Case> {
 protected:
  const CameraModel& model() const { return GetParam().model; }
  cv::Matx33d matrix() const {  // OpenCV's first pixel centre is (0, 0)
    return {model().fx, 0, model().cx - 0.5, 0, model().fy, model().cy - 0.5, 0, 0, 1};
  }
  // A direction at `share` of the model's valid radius, or of 85 degrees where there is no limit.
  Eigen::Vector3d direction(double share, double azimuth) const {
    double radius = model().validRadius();
    if (model().kind == Kind::Fisheye) {
      const double theta = share * radius;
      return {std::sin(theta) * std::cos(azimuth), std::sin(theta) * std::sin(azimuth), std::cos(theta)};
    }
    radius = std::min(radius, std::tan(85 * CV_PI / 180));
    return {share * radius * std::cos(azimuth), share * radius * std::sin(azimuth), 1};
  }
};

TEST_P(CameraModelEveryKind, IsUsable) { EXPECT_EQ(model().problem(), std::nullopt); }

TEST_P(CameraModelEveryKind, PixelReturnsThroughItsDirectionWithin1e6) {
  int inside = 0;
  for (int i = 0; i < 20000; ++i) {
    std::mt19937_64 random(static_cast<std::uint64_t>(i));
    const Eigen::Vector2d pixel(std::uniform_real_distribution(-200.0, 1800.0)(random),
                                std::uniform_real_distribution(-200.0, 1400.0)(random));
    const auto unit = model().unproject(pixel);
    if (!unit) continue;
    ++inside;
    ASSERT_NEAR(unit->norm(), 1, 1e-14);
    const auto back = model().project(*unit * 37.5);
    ASSERT_TRUE(back) << pixel.transpose();
    ASSERT_LT((*back - pixel).norm(), 1e-6) << pixel.transpose();
  }
  EXPECT_GT(inside, 10000);  // the image itself lies inside every one of these models
}

TEST_P(CameraModelEveryKind, DirectionReturnsThroughItsPixel) {
  for (int i = 1; i < 2000; ++i) {
    const Eigen::Vector3d there = direction(0.998 * i / 2000.0, 2.399963 * i).normalized();
    const auto pixel = model().project(there);
    ASSERT_TRUE(pixel) << i;
    const auto back = model().unproject(*pixel);
    ASSERT_TRUE(back) << i;
    ASSERT_LT((*back - there).norm(), 1e-9) << i;
  }
}

TEST_P(CameraModelEveryKind, OutsideTheValidRadiusThereIsNoPixel) {
  if (std::isinf(model().validRadius())) {
    EXPECT_TRUE(model().project({1e4, 1e4, 1}));
    return;
  }
  if (model().kind == Kind::Fisheye && model().validRadius() >= CV_PI) {
    EXPECT_TRUE(model().project({1e-4, 0, -1}));
    return;
  }
  for (int i = 0; i < 100; ++i) {
    const double radius = model().validRadius() * (1.0001 + 0.01 * i);
    const Eigen::Vector3d there = model().kind == Kind::Fisheye
                                      ? Eigen::Vector3d(std::sin(radius), 0, std::cos(radius))
                                      : Eigen::Vector3d(radius, 0, 1);
    if (model().kind == Kind::Fisheye && radius > CV_PI) break;
    EXPECT_FALSE(model().project(there)) << radius;
  }
}

TEST_P(CameraModelEveryKind, AgreesWithOpenCvProjection) {
  double largest = 0;
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3d there = direction(0.95 * i / 2000.0, 2.399963 * i) * 12.0;
    if (there.z() <= 0.05) continue;  // OpenCV's fisheye knows the front half only
    const auto ours = model().project(there);
    ASSERT_TRUE(ours);
    std::vector<cv::Point2d> theirs;
    const std::vector<cv::Point3d> point = {{there.x(), there.y(), there.z()}};
    if (model().kind == Kind::Fisheye) {
      cv::fisheye::projectPoints(point, theirs, cv::Vec3d(), cv::Vec3d(), matrix(), model().distortion);
    } else {
      cv::projectPoints(point, cv::Vec3d(), cv::Vec3d(), matrix(), model().distortion, theirs);
    }
    largest = std::max(largest, (*ours - Eigen::Vector2d(theirs[0].x + 0.5, theirs[0].y + 0.5)).norm());
  }
  EXPECT_LT(largest, 1e-6);
}

TEST_P(CameraModelEveryKind, AgreesWithOpenCvUndistortion) {
  const cv::TermCriteria exact(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 500, 1e-13);
  int compared = 0;
  for (int y = 50; y < 1200; y += 100) {
    for (int x = 50; x < 1600; x += 100) {
      const auto ours = model().unproject({x + 0.5, y + 0.5});
      if (!ours || ours->z() < 0.2) continue;
      std::vector<cv::Point2d> theirs;
      const std::vector<cv::Point2d> pixel = {{double(x), double(y)}};
      if (model().kind == Kind::Fisheye) {
        cv::fisheye::undistortPoints(pixel, theirs, matrix(), model().distortion);
      } else {
        cv::undistortPoints(pixel, theirs, matrix(), model().distortion, cv::noArray(), cv::noArray(), exact);
      }
      // OpenCV's fixed-point iteration does not always converge: it is compared where its own answer holds.
      const auto again = model().project({theirs[0].x, theirs[0].y, 1});
      if (!again || (*again - Eigen::Vector2d(x + 0.5, y + 0.5)).norm() > 1e-7) continue;
      ++compared;
      EXPECT_LT((ours->hnormalized() - Eigen::Vector2d(theirs[0].x, theirs[0].y)).norm() * 1200, 1e-6);
    }
  }
  EXPECT_GT(compared, 60);
}

INSTANTIATE_TEST_SUITE_P(Models, CameraModelEveryKind, testing::ValuesIn(cases()),
                         [](const auto& test) { return test.param.name; });

TEST(CameraModel, NeverReturnsADirectionOutsideItsDomainForAnyPixel) {
  for (const auto& [name, model] : cases()) {
    for (int i = 0; i < 5000; ++i) {
      std::mt19937_64 random(static_cast<std::uint64_t>(i));
      const Eigen::Vector2d pixel(std::uniform_real_distribution(-1e5, 1e5)(random),
                                  std::uniform_real_distribution(-1e5, 1e5)(random));
      const auto unit = model.unproject(pixel);
      if (!unit) continue;
      const auto back = model.project(*unit);
      ASSERT_TRUE(back) << name << " " << pixel.transpose();
      ASSERT_LT((*back - pixel).norm(), 1e-6 * (1 + pixel.norm() / 1000)) << name << " " << pixel.transpose();
    }
  }
}

TEST(CameraModel, FoldingBarrelEndsWhereTheImageOfARayTurnsBack) {
  // f(r) = r - 0.35 r^3 turns at r = 1/sqrt(1.05).
  const CameraModel model = camera(Kind::RadialTangential, {-0.35, 0, 0, 0});
  EXPECT_NEAR(model.validRadius(), 1 / std::sqrt(1.05), 1e-12);
  EXPECT_TRUE(model.project({0.97, 0, 1}));
  EXPECT_FALSE(model.project({0.98, 0, 1}));
  EXPECT_FALSE(model.project({3, 0, 1}));  // OpenCV would put this back into the image
}

TEST(CameraModel, BehindTheCameraThereIsNoPixelExceptForFisheye) {
  EXPECT_FALSE(camera(Kind::Pinhole, {}).project({0.1, 0.1, -1}));
  EXPECT_FALSE(camera(Kind::Pinhole, {}).project({0.1, 0.1, 0}));
  EXPECT_FALSE(camera(Kind::RadialTangential, {0, 0, 0, 0}).project({0, 0, -1}));
  EXPECT_TRUE(camera(Kind::Fisheye, {0, 0, 0, 0}).project({1, 0, -0.2}));
}

TEST(CameraModel, NonFinitePointsAndPixelsAreOutside) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  for (const auto& [name, model] : cases()) {
    EXPECT_FALSE(model.project({nan, 0, 1})) << name;
    EXPECT_FALSE(model.project({0, inf, 1})) << name;
    EXPECT_FALSE(model.unproject({nan, 3})) << name;
    EXPECT_FALSE(model.unproject({5, -inf})) << name;
  }
}

TEST(CameraModel, HalfTheSizeSeesTheSameDirections) {
  const CameraModel full = camera(Kind::RadialTangential, {-0.0128, 0.0053, 0.0030, 0.0060});
  const CameraModel half = full.scaled(0.5);
  EXPECT_EQ(half.width, 800);
  EXPECT_EQ(half.height, 600);
  const Eigen::Vector2d pixel(1234.5, 77.25);
  EXPECT_LT((*full.unproject(pixel) - *half.unproject(0.5 * pixel)).norm(), 1e-14);
}

TEST(CameraModel, SaysWhatIsWrong) {
  const CameraModel good = camera(Kind::RadialTangential, {0, 0, 0, 0});
  ASSERT_FALSE(good.problem());
  const auto problem = [&](auto change) {
    CameraModel model = good;
    change(model);
    return model.problem().value_or("");
  };
  EXPECT_NE(problem([](auto& m) { m.width = 0; }).find("0x1200"), std::string::npos);
  EXPECT_NE(problem([](auto& m) { m.height = 1 << 30; }).find("image size"), std::string::npos);
  EXPECT_NE(problem([](auto& m) { m.fx = std::nan(""); }).find("fx"), std::string::npos);
  EXPECT_NE(problem([](auto& m) { m.fy = -3; }).find("fy"), std::string::npos);
  EXPECT_NE(problem([](auto& m) { m.cx = 1e9; }).find("cx"), std::string::npos);
  EXPECT_NE(problem([](auto& m) { m.distortion.resize(3); }).find("4, 5 or 8"), std::string::npos);
  EXPECT_NE(problem([](auto& m) { m.distortion[1] = std::nan(""); }).find("nan"), std::string::npos);
  EXPECT_NE(problem([](auto& m) {
              m.distortion[0] = -1e5;
              m.cx = -500;
            }).find("one to one"),
            std::string::npos);
}

}  // namespace
}  // namespace overfly::capture
