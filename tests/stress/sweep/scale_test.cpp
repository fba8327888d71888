// Relative accuracy does not depend on how high the drone flies or how long its lens is.
#include <gtest/gtest.h>

#include "tests/stress/hard_case/hard_case.h"
#include "tests/stress/sweep/placed_scene.h"

namespace overfly::test {
namespace {

class Scale : public GlTest {};

// The scene and everything in it made larger; returns RMSE in GSD.
double rmsAt(gl::Context& context, const PlacedViews& views, double factor) {
  const int zoom = kZoom - static_cast<int>(std::lround(std::log2(factor)));
  const geo::TileFrame frame(geo::TileLattice::local({geo::radians(47.38), geo::radians(8.54), 0}),
                             {zoom, 0, 0});
  // The zoom follows the scale in steps of two; the rest is the scene's.
  const tiling::HeightField field =
      sweepOf(context, gridOf(frame, 455, factor), views.at(frame.local(), 455, factor));
  const FieldErrors errors = errorsOf(field, frame, hills().ground, 455, factor);
  std::printf("complete %.3f, ", errors.complete());
  if (errors.complete() < 0.75) return INFINITY;
  return FieldErrors::rms(errors.all) / kPixel;
}

TEST_F(Scale, FromTwoMetresToFiveThousand) {
  const PlacedViews views(context(), fivePhotos(lookOf(hills())));
  double least = 1e9, most = 0;
  for (const double altitude : {2.0, 5.0, 15.0, 60.0, 250.0, 1000.0, 5000.0}) {
    const double rms = rmsAt(context(), views, altitude / kUp);
    std::printf("%.0f m: RMSE %.3f GSD\n", altitude, rms);
    least = std::min(least, rms);
    most = std::max(most, rms);
  }
  expectAtMost("scale/altitude", "largest over smallest RMSE in GSD, 2 to 5,000 m", most / least, 2);
}

TEST_F(Scale, FocalLengthsFromTwoHundredToTwentyThousandPixels) {
  // The picture always covers the tile: a longer lens flies higher, and its GSD and baselines stay in
  // proportion.
  const Scene scene = hills();
  double least = 1e9, most = 0;
  for (const double focal : {200.0, 1000.0, 5000.0, 20000.0}) {
    const double up = kPixel * focal;
    std::vector<Station> stations;
    for (int i = 0; i < 5; ++i) {
      // The same angles of intersection: baselines grow with the height, and the cameras look inwards.
      const Eigen::Vector3d eye{up * 0.15 * (i % 3 - 1), up * 0.12 * (i / 3 - 0.5), up};
      stations.push_back(lookingAt(eye, {0, 0, 0}));
    }
    const PlacedViews views(context(), photographs(lookOf(scene), stations, sceneCamera(220, focal)));
    const geo::TileFrame frame = localTile(geo::radians(47.38), geo::radians(8.54));
    const tiling::HeightField field =
        sweepOf(context(), gridOf(frame, 455, 1, 8, 12), views.at(frame.local(), 455));
    const FieldErrors errors = errorsOf(field, frame, scene.ground, 455);
    std::printf("%.0f pixels: RMSE %.3f GSD, complete %.3f\n", focal, FieldErrors::rms(errors.all) / kPixel,
                errors.complete());
    EXPECT_GE(errors.complete(), 0.9) << focal;
    least = std::min(least, FieldErrors::rms(errors.all));
    most = std::max(most, FieldErrors::rms(errors.all));
  }
  expectKnownLimit({"scale/focal-length", "largest over smallest RMSE, 200 to 20,000 pixels", most / least,
                    HardCase::Must::BeAtMost, 2});
}

}  // namespace
}  // namespace overfly::test
