// View sets that say little or nothing about heights: the answer is "no data", or right; never a confident
// wrong number.
#include <gtest/gtest.h>

#include "tests/stress/hard_case/hard_case.h"
#include "tests/stress/sweep/placed_scene.h"

namespace overfly::test {
namespace {

constexpr double kGround = 455;
constexpr double kWrong = 5 * kPixel;  // an error that a believed height must not have
constexpr double kShare = 0.005;       // of all texels

class Degenerate : public GlTest {
 protected:
  struct Outcome {
    FieldErrors errors;
    std::string reason;
    std::size_t not_numbers = 0;
  };
  static Outcome outcomeOf(const std::vector<Station>& stations, const capture::CameraModel& camera,
                           double below = 12, double above = 25) {
    const Scene scene = hills();
    const PlacedViews views(context(), photographs(lookOf(scene), stations, camera));
    return sweepViews(views.at(frame().local(), kGround), below, above);
  }
  static Outcome sweepViews(const std::vector<tiling::SweepView>& views, double below = 12,
                            double above = 25) {
    const tiling::HeightField field = sweepOf(context(), gridOf(frame(), kGround, 1, below, above), views);
    Outcome outcome{errorsOf(field, frame(), hills().ground, kGround), field.reason, 0};
    for (std::size_t i = 0; i < field.height.size(); ++i)
      outcome.not_numbers += std::isinf(field.height[i]) || std::isnan(field.score[i]) ? 1 : 0;
    return outcome;
  }
  static void expectSafe(const std::string& id, const std::string& what, const Outcome& outcome) {
    expectAtMost("degenerate/" + id, "share believed and wrong by over 5 GSD: " + what,
                 outcome.errors.confidentWrong(kWrong), kShare);
    EXPECT_EQ(outcome.not_numbers, 0u) << what;
  }
  static const geo::TileFrame& frame() {
    static const geo::TileFrame tile = localTile(geo::radians(47.38), geo::radians(8.54));
    return tile;
  }
  static capture::CameraModel camera() { return sceneCamera(220, kFocal); }
};

TEST_F(Degenerate, TinyBaselines) {
  for (const double baseline : {0.0, 0.001, 0.01, 0.1}) {
    const std::vector<Station> pair{straightDown(0, 0, 100), straightDown(baseline, 0, 100),
                                    straightDown(0, baseline, 100)};
    const Outcome outcome = outcomeOf(pair, sceneCamera(220, 400));
    expectSafe("tiny-baseline", std::to_string(baseline) + " m at 100 m", outcome);
    if (baseline == 0) {
      EXPECT_FALSE(outcome.reason.empty());
    }
  }
}

TEST_F(Degenerate, PureRotation) {
  std::vector<Station> stations;
  for (int i = 0; i < 5; ++i) {
    Station station = straightDown(0, 0, kUp);
    station.enu_from_camera =
        Eigen::AngleAxisd(0.04 * (i - 2), Eigen::Vector3d(1, 0.5, 0).normalized()) * station.enu_from_camera;
    stations.push_back(station);
  }
  const Outcome outcome = outcomeOf(stations, camera());
  expectSafe("pure-rotation", "five directions from one place", outcome);
}

TEST_F(Degenerate, OneViewAndNone) {
  const Outcome one = outcomeOf({straightDown(0, 0, kUp)}, camera());
  expectAtMost("degenerate/one-view", "heights from one view", one.errors.complete(), 0);
  EXPECT_FALSE(one.reason.empty());
  EXPECT_FALSE(sweepViews({}).reason.empty());
}

TEST_F(Degenerate, CollinearCentres) {
  std::vector<Station> line;
  for (int i = -2; i <= 2; ++i) line.push_back(straightDown(8.0 * i, 0, kUp));
  const Outcome outcome = outcomeOf(line, camera());
  expectSafe("collinear", "five centres on one line", outcome);
  expectAtLeast("degenerate/collinear", "complete", outcome.errors.complete(), 0.98);
}

TEST_F(Degenerate, SixtyFourViews) {
  std::vector<Station> many;
  for (int i = 0; i < 64; ++i) {
    const int at = (37 * i) % 64;  // all over the place, not row by row
    many.push_back(straightDown(3.0 * (at % 8) - 10.5, 3.0 * (at / 8) - 10.5, kUp + 0.1 * i));
  }
  const Outcome outcome = outcomeOf(many, sceneCamera(160, 175));
  expectSafe("many-views", "64 views", outcome);
  expectAtLeast("degenerate/many-views", "complete", outcome.errors.complete(), 0.98);
}

TEST_F(Degenerate, ViewsFromOppositeSides) {
  const std::vector<Station> opposite{lookingAt({-45, 0, 40}, {0, 0, 0}), lookingAt({45, 0, 40}, {0, 0, 0})};
  expectSafe("opposite", "two views 97 degrees apart", outcomeOf(opposite, sceneCamera(260, 300)));
}

TEST_F(Degenerate, CamerasAtAndBelowThePlanes) {
  std::vector<Station> stations = fiveStations();
  stations[1].eye.z() = 20;  // inside the range that is searched, above the ground
  const Outcome within = outcomeOf(stations, camera());
  expectSafe("camera-in-range", "one camera at 20 m, planes up to 25 m", within);
  // Exactly on a plane of the sweep, and below the ground.
  const PlacedViews views(context(), fivePhotos(lookOf(hills())));
  std::vector<tiling::SweepView> moved = views.at(frame().local(), kGround);
  moved[0].pose.position_in_ecef = frame().local().ecefFromEnu({0, 0, kGround - 12});
  expectSafe("camera-in-range", "one camera exactly on the lowest plane", sweepViews(moved));
  moved[0].pose.position_in_ecef = frame().local().ecefFromEnu({0, 0, kGround - 30});
  const Outcome under = sweepViews(moved);
  expectSafe("camera-under-ground", "one camera 30 m under the ground", under);
}

TEST_F(Degenerate, PointsBehindACamera) {
  std::vector<Station> stations = fiveStations();
  stations[2].enu_from_camera =
      stations[2].enu_from_camera *
      Eigen::AngleAxisd(geo::radians(100), Eigen::Vector3d::UnitX()).toRotationMatrix();
  const PlacedViews views(context(), fivePhotos(lookOf(hills())));
  std::vector<tiling::SweepView> set = views.at(frame().local(), kGround);
  set[2].pose = poseAt(stations[2], frame().local(), kGround);
  const Outcome outcome = sweepViews(set);
  expectSafe("behind-camera", "one of five cameras looks at the sky", outcome);
  expectAtLeast("degenerate/behind-camera", "complete from the other four", outcome.errors.complete(), 0.95);
}

TEST_F(Degenerate, PrincipalPointOutsideThePicture) {
  // A crop of a larger picture: the axis leaves it.
  capture::CameraModel shifted = camera();
  shifted.cx = -60;
  std::vector<Station> stations;
  for (const Station& station : fiveStations())
    stations.push_back(
        straightDown(1.7 * station.eye.x() - (110 + 60) * kPixel, 1.7 * station.eye.y(), station.eye.z()));
  const Outcome outcome = outcomeOf(stations, shifted);
  expectSafe("principal-point", "the axis 60 pixels outside the picture", outcome);
  expectAtLeast("degenerate/principal-point", "complete", outcome.errors.complete(), 0.95);
}

// Beyond its monotone domain a lens model would fold the picture over: there is no pixel there.
TEST_F(Degenerate, DistortionBeyondItsMonotoneDomain) {
  capture::CameraModel lens = camera();
  lens.kind = capture::CameraModel::Kind::RadialTangential;
  lens.distortion = {-0.9, 0, 0, 0};
  ASSERT_LT(lens.validRadius(), 1.0);
  std::size_t folded = 0, checked = 0;
  for (int step = 1; step < 300; ++step) {
    const double r = 0.01 * step;
    const auto pixel = lens.project({r, 0, 1});
    ++checked;
    if (r > lens.validRadius() + 1e-9 && pixel) ++folded;
    if (!pixel) continue;
    const auto back = lens.unproject(*pixel);
    if (!back || std::abs(back->x() / back->z() - r) > 1e-6) ++folded;
  }
  EXPECT_EQ(checked, 299u);
  expectAtMost("degenerate/distortion", "directions that a fold would mistake for another",
               static_cast<double>(folded), 0);
}

// The planes are swept in either order alike: what a lower search range adds below changes nothing.
TEST_F(Degenerate, TheRangeDoesNotMoveTheGround) {
  const PlacedViews views(context(), fivePhotos(lookOf(hills())));
  const auto set = views.at(frame().local(), kGround);
  const tiling::HeightField narrow = sweepOf(context(), gridOf(frame(), kGround, 1, 6, 6), set);
  const tiling::HeightField wide = sweepOf(context(), gridOf(frame(), kGround, 1, 30, 30), set);
  std::size_t apart = 0, both = 0;
  for (std::size_t i = 0; i < narrow.height.size(); ++i) {
    if (std::isnan(narrow.height[i]) || std::isnan(wide.height[i])) continue;
    ++both;
    apart += std::abs(narrow.height[i] - wide.height[i]) > static_cast<float>(kPixel) ? 1 : 0;
  }
  expectAtMost("degenerate/range",
               "share of texels that move by over a GSD when the range is 5 times as wide",
               static_cast<double>(apart) / static_cast<double>(both), 0.01);
}

}  // namespace
}  // namespace overfly::test
