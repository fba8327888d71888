// A pose is what it says, however it is written down.
#include <gtest/gtest.h>

#include "tests/stress/hard_case/hard_case.h"
#include "tests/stress/sweep/placed_scene.h"

namespace overfly::test {
namespace {

class PoseRepresentation : public GlTest {
 protected:
  void SetUp() override {
    GlTest::SetUp();
    frame_ = std::make_unique<geo::TileFrame>(localTile(geo::radians(-33.9), geo::radians(18.4)));
    if (!views_) views_ = std::make_unique<PlacedViews>(context(), fivePhotos(lookOf(hills())));
  }
  static void TearDownTestSuite() { views_.reset(); }

  tiling::HeightField sweepWith(const std::function<void(std::vector<tiling::SweepView>&)>& change) {
    std::vector<tiling::SweepView> views = views_->at(frame_->local(), 40);
    change(views);
    return sweepOf(context(), gridOf(*frame_, 40), views);
  }
  // Largest difference of two fields where both have a height; infinite when they do not have the same
  // texels.
  static double largestDifference(const tiling::HeightField& a, const tiling::HeightField& b) {
    double most = 0;
    std::size_t other = 0;
    for (std::size_t i = 0; i < a.height.size(); ++i) {
      if (std::isnan(a.height[i]) != std::isnan(b.height[i])) ++other;
      if (std::isnan(a.height[i]) || std::isnan(b.height[i])) continue;
      most = std::max(most, std::abs(static_cast<double>(a.height[i]) - static_cast<double>(b.height[i])));
    }
    return other > a.height.size() / 1000 ? INFINITY : most;
  }
  static std::size_t notFinite(const tiling::HeightField& field) {
    std::size_t bad = 0;
    for (std::size_t i = 0; i < field.height.size(); ++i)
      bad += std::isinf(field.height[i]) || std::isnan(field.score[i]) ||
                     std::isnan(field.height[i]) != (field.confidence[i] == 0)
                 ? 1
                 : 0;
    return bad;
  }

  std::unique_ptr<geo::TileFrame> frame_;
  static std::unique_ptr<PlacedViews> views_;
};
std::unique_ptr<PlacedViews> PoseRepresentation::views_;

TEST_F(PoseRepresentation, BothSignsOfAQuaternionAreOneRotation) {
  const auto plain = sweepWith([](auto&) {});
  const auto negated = sweepWith([](auto& views) {
    for (std::size_t i = 0; i < views.size(); i += 2) views[i].pose.ecef_from_camera.coeffs() *= -1;
  });
  expectAtMost("pose/sign", "height change when q becomes -q, m", largestDifference(plain, negated), 0);
}

TEST_F(PoseRepresentation, ANearlyNormalisedQuaternionIsNormalised) {
  const auto plain = sweepWith([](auto&) {});
  const auto scaled = sweepWith([](auto& views) {
    for (tiling::SweepView& view : views) view.pose.ecef_from_camera.coeffs() *= 1 + 5e-4;
  });
  expectAtMost("pose/normalisation", "height change when |q| is 1.0005, m", largestDifference(plain, scaled),
               1e-3);
  const auto doubled = sweepWith([](auto& views) { views[1].pose.ecef_from_camera.coeffs() *= 2; });
  expectAtMost("pose/normalisation", "heights from a set with |q| = 2, which is refused",
               doubled.reason.empty() ? 1 : 0, 0);
}

TEST_F(PoseRepresentation, ATinyRotationIsATinyChange) {
  const auto plain = sweepWith([](auto&) {});
  const auto turned = sweepWith([](auto& views) {
    for (tiling::SweepView& view : views)
      view.pose.ecef_from_camera =
          Eigen::Quaterniond(Eigen::AngleAxisd(1e-9, Eigen::Vector3d(1, 2, 3).normalized())) *
          view.pose.ecef_from_camera;
  });
  // A texel whose two best planes are equal may change sides: the 99.9th percentile is the figure.
  std::vector<double> change;
  for (std::size_t i = 0; i < plain.height.size(); ++i)
    if (!std::isnan(plain.height[i]) && !std::isnan(turned.height[i]))
      change.push_back(
          std::abs(static_cast<double>(plain.height[i]) - static_cast<double>(turned.height[i])));
  std::sort(change.begin(), change.end());
  expectAtMost("pose/tiny-rotation", "height change by a rotation of 1e-9, 99.9th percentile, m",
               change[change.size() * 999 / 1000], 1e-3);
}

TEST_F(PoseRepresentation, HorizontalAndUpsideDownViewsHarmNobody) {
  const auto plain = sweepWith([](auto&) {});
  for (const double pitch : {90.0, 180.0, 90.0001, 89.9999}) {
    const auto odd = sweepWith([&](auto& views) {
      views.back().pose.ecef_from_camera =
          views.back().pose.ecef_from_camera *
          Eigen::Quaterniond(Eigen::AngleAxisd(geo::radians(pitch), Eigen::Vector3d::UnitX()));
    });
    expectAtMost("pose/horizontal", "texels that are not numbers, a view turned up by 90 to 180 degrees",
                 static_cast<double>(notFinite(odd)), 0);
    const FieldErrors errors = errorsOf(odd, *frame_, hills().ground, 40);
    expectAtMost(
        "pose/horizontal", "RMSE against that of the whole set",
        FieldErrors::rms(errors.all) / FieldErrors::rms(errorsOf(plain, *frame_, hills().ground, 40).all),
        1.5);
  }
}

TEST_F(PoseRepresentation, ExactlyNadirHasNoJumpAtAnyHeading) {
  double worst = 0;
  for (const double yaw : {0.0, 90.0, 180.0, 270.0, 359.9999999}) {
    std::vector<PlacedPhoto> turned;
    for (Station station : fiveStations()) {
      station.enu_from_camera =
          station.enu_from_camera *
          Eigen::AngleAxisd(geo::radians(yaw), Eigen::Vector3d::UnitZ()).toRotationMatrix();
      turned.push_back(photograph(lookOf(hills()), sceneCamera(220, kFocal), station));
    }
    const PlacedViews views(context(), std::move(turned));
    const auto field = sweepOf(context(), gridOf(*frame_, 40), views.at(frame_->local(), 40));
    worst = std::max(worst, FieldErrors::rms(errorsOf(field, *frame_, hills().ground, 40).all));
  }
  expectAtMost("pose/nadir-heading", "largest RMSE at five headings, GSD", worst / kPixel, 0.25 * kUp / 9);
}

}  // namespace
}  // namespace overfly::test
