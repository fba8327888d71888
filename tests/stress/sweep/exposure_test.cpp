// Pictures of the same ground in other light.
#include <gtest/gtest.h>

#include "tests/stress/hard_case/hard_case.h"
#include "tests/stress/sweep/placed_scene.h"

namespace overfly::test {
namespace {

class Exposure : public GlTest {
 protected:
  using Tone = std::function<double(double)>;  // grey 0..1 to grey 0..1

  // RMSE in GSD when one view of five (or, `most`, two) is changed; infinite when half of the texels are
  // gone.
  static FieldErrors errorsWith(const Tone& tone, tiling::MatchCost cost, int changed = 1,
                                bool better_half = false) {
    std::vector<PlacedPhoto> photos = fivePhotos(lookOf(hills()));
    for (int k = 0; k < changed; ++k) {
      Photo& photo = photos[static_cast<std::size_t>(2 * k + 1)].photo;
      for (std::size_t i = 0; i < photo.luma.size(); ++i) {
        const double value = std::clamp(tone(photo.luma[i] / 255.0), 0.0, 1.0);
        photo.luma[i] = static_cast<std::uint8_t>(std::lround(255 * value));
        for (std::size_t c = 0; c < 3; ++c) photo.rgba[4 * i + c] = photo.luma[i];
      }
    }
    const PlacedViews views(context(), std::move(photos));
    const geo::TileFrame frame = localTile(geo::radians(47.38), geo::radians(8.54));
    tiling::SweepOptions options;
    options.cost = cost;
    // The threshold is a correlation: of the other costs the score is a difference, and any counts.
    if (cost != tiling::MatchCost::Zncc) options.min_score = -1e9;
    options.better_half = better_half;
    const tiling::HeightField field =
        sweepOf(context(), gridOf(frame, 455),
                views.at(frame.local(), 455, 1, cost != tiling::MatchCost::Zncc), options);
    return errorsOf(field, frame, hills().ground, 455);
  }
  // RMSE in GSD; infinite when half of the texels are gone.
  static double rmsWith(const Tone& tone, tiling::MatchCost cost, int changed = 1) {
    const FieldErrors errors = errorsWith(tone, cost, changed);
    return errors.complete() < 0.5 ? INFINITY : FieldErrors::rms(errors.all) / kPixel;
  }
  // The bound everywhere: a quarter of a GSD times height over baseline, as for unchanged pictures.
  static constexpr double kBar = 0.25 * kUp / 9;
};

TEST_F(Exposure, BrighterDarkerAndGammaDoNotMoveTheGround) {
  for (const auto& [cost, name] : {std::pair{tiling::MatchCost::Zncc, std::string("zncc")},
                                   std::pair{tiling::MatchCost::Census, std::string("census")}}) {
    expectAtMost("exposure/" + name, "RMSE, GSD: one view at half the brightness",
                 rmsWith([](double v) { return 0.5 * v + 0.1; }, cost), kBar);
    expectAtMost("exposure/" + name, "RMSE, GSD: one view with gamma 1.8",
                 rmsWith([](double v) { return std::pow(v, 1.8); }, cost), kBar);
    expectAtMost("exposure/" + name, "RMSE, GSD: two views of five with other gains",
                 rmsWith([](double v) { return 0.6 * v + 0.25; }, cost, 2), kBar);
  }
}

TEST_F(Exposure, AnInvertedViewCostsHeightsNotTheirTruth) {
  const FieldErrors errors = errorsWith([](double v) { return 1 - v; }, tiling::MatchCost::Zncc, 1, true);
  expectAtMost("exposure/inverted-wrong",
               "share believed and wrong by over 5 GSD: one of five views negative",
               errors.confidentWrong(5 * kPixel), 0.005);
  expectKnownLimit({"exposure/inverted", "complete, one of five views negative (ZNCC, better half)",
                    errors.complete(), HardCase::Must::BeAtLeast, 0.5});
}

TEST_F(Exposure, SadHasItsLimit) {
  const double plain = rmsWith([](double v) { return v; }, tiling::MatchCost::Sad);
  const double dark = rmsWith([](double v) { return 0.5 * v + 0.1; }, tiling::MatchCost::Sad);
  expectAtMost("exposure/sad", "RMSE, GSD: equal exposures", plain, kBar);
  RecordProperty("sad_dark_rms_gsd", std::to_string(dark));
  std::printf("SAD with one view at half the brightness: RMSE %.3f GSD, %.2f times that of equal exposures\n",
              dark, dark / plain);
}

}  // namespace
}  // namespace overfly::test
