#include "tiling/sweep/path_aggregation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace overfly::tiling {
namespace {

constexpr int kSide = 24, kPlanes = 16;

// Scores that peak at truth(x, y), under noise as strong as the peak.
template <typename Truth>
PlaneVolume noisyVolume(const Truth& truth, float noise) {
  std::mt19937 random(11);
  std::uniform_real_distribution<float> any(0.0f, noise);
  PlaneVolume volume(kSide, kPlanes);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x)
      for (int p = 0; p < kPlanes; ++p)
        volume.at(static_cast<std::size_t>(y * kSide + x), p) =
            std::max(0.0f, 0.5f - 0.25f * std::abs(static_cast<float>(p) - truth(x, y))) + any(random);
  return volume;
}

template <typename Truth>
int wrongTexels(const std::vector<PlaneVolume::Choice>& choice, const Truth& truth, float tolerance) {
  int wrong = 0;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x)
      wrong +=
          std::abs(choice[static_cast<std::size_t>(y * kSide + x)].plane - truth(x, y)) > tolerance ? 1 : 0;
  return wrong;
}

TEST(PlaneVolume, FindsAFlatPlaneUnderNoiseThatHidesItFromSingleTexels) {
  const auto truth = [](int, int) { return 6.0f; };
  PlaneVolume volume = noisyVolume(truth, 0.7f);
  int single = 0;
  for (std::size_t i = 0; i < kSide * kSide; ++i) {
    int best = 0;
    for (int p = 1; p < kPlanes; ++p)
      if (volume.at(i, p) > volume.at(i, best)) best = p;
    single += std::abs(best - 6) > 1 ? 1 : 0;
  }
  EXPECT_GT(single, kSide * kSide / 20) << "the noise hides nothing: the test shows nothing";
  EXPECT_LE(wrongTexels(volume.aggregate(0.1f, 0.5f), truth, 1.0f), kSide * kSide / 200);
}

TEST(PlaneVolume, KeepsAJumpWhereItIs) {
  const auto truth = [](int x, int) { return x < kSide / 2 ? 3.0f : 12.0f; };
  const std::vector<PlaneVolume::Choice> choice = noisyVolume(truth, 0.3f).aggregate(0.1f, 0.5f);
  EXPECT_LE(wrongTexels(choice, truth, 1.0f), kSide * kSide / 100);
  for (int y = 0; y < kSide; ++y) {
    EXPECT_LT(choice[static_cast<std::size_t>(y * kSide + kSide / 2 - 2)].plane, 5.0f) << y;
    EXPECT_GT(choice[static_cast<std::size_t>(y * kSide + kSide / 2 + 1)].plane, 10.0f) << y;
  }
}

TEST(PlaneVolume, RefinesBetweenPlanesAndGivesTheTexelsOwnScore) {
  PlaneVolume volume(4, 8);
  for (std::size_t i = 0; i < 16; ++i)
    for (int p = 0; p < 8; ++p) {
      const float d = static_cast<float>(p) - 3.3f;
      volume.at(i, p) = 1 - 0.1f * d * d;
    }
  for (const PlaneVolume::Choice& choice : volume.aggregate(10.0f, 10.0f)) {
    EXPECT_NEAR(choice.plane, 3.3f, 1e-3f);
    EXPECT_NEAR(choice.score, 1 - 0.1f * 0.09f, 1e-5f);
    EXPECT_NEAR(choice.drop, 0.1f * (0.49f - 0.09f), 1e-5f);
  }
}

TEST(PlaneVolume, DoesNotDependOnTheOrientationOfTheGrid) {
  const auto truth = [](int x, int y) {
    return 2.0f + 0.2f * static_cast<float>(x) + 0.1f * static_cast<float>(y);
  };
  PlaneVolume volume = noisyVolume(truth, 0.4f), turned(kSide, kPlanes);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x)
      for (int p = 0; p < kPlanes; ++p)
        turned.at(static_cast<std::size_t>(x * kSide + (kSide - 1 - y)), p) =
            volume.at(static_cast<std::size_t>(y * kSide + x), p);
  const auto a = volume.aggregate(0.1f, 0.5f), b = turned.aggregate(0.1f, 0.5f);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x)
      ASSERT_NEAR(a[static_cast<std::size_t>(y * kSide + x)].plane,
                  b[static_cast<std::size_t>(x * kSide + (kSide - 1 - y))].plane, 1e-2f);
}

}  // namespace
}  // namespace overfly::tiling
