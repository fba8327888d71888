#include "tiling/sweep/height_filter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace overfly::tiling {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

std::size_t at(int x, int y, int side) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(side) + static_cast<std::size_t>(x);
}

std::vector<float> flat(int side, float value) {
  return std::vector<float>(static_cast<std::size_t>(side) * static_cast<std::size_t>(side), value);
}

TEST(MedianHeights, TakesOutASpikeAndLeavesAStep) {
  constexpr int kSide = 16;
  std::vector<float> height = flat(kSide, 1.0f);
  for (int y = 0; y < kSide; ++y)
    for (int x = 8; x < kSide; ++x) height[at(x, y, kSide)] = 5.0f;
  const std::vector<float> clean = height;
  height[at(4, 4, kSide)] = 100.0f;
  height[at(12, 9, kSide)] = -100.0f;
  for (const int radius : {1, 2}) EXPECT_EQ(medianHeights(height, kSide, radius), clean) << radius;
  EXPECT_EQ(medianHeights(height, kSide, 0), height);
}

TEST(SmoothHeights, CalmsNoiseButKeepsAStepOfOneMetre) {
  constexpr int kSide = 48;
  constexpr double kEdge = 0.2;
  std::mt19937 random(7);
  std::normal_distribution<float> noise(0.0f, 0.03f);
  std::vector<float> height(flat(kSide, 0.0f)), score(flat(kSide, 0.8f));
  const auto truth = [](int x) { return x < kSide / 2 ? 0.0f : 1.0f; };
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) height[at(x, y, kSide)] = truth(x) + noise(random);
  const std::vector<float> smooth = smoothHeights(height, score, kSide, kEdge);
  double before = 0, after = 0;
  for (int y = 2; y < kSide - 2; ++y)
    for (int x = 2; x < kSide - 2; ++x) {
      const float was = height[at(x, y, kSide)] - truth(x), is = smooth[at(x, y, kSide)] - truth(x);
      EXPECT_LT(std::abs(is), 0.1f) << x << ", " << y;
      before += static_cast<double>(was * was);
      after += static_cast<double>(is * is);
    }
  EXPECT_LT(std::sqrt(after / before), 0.4);  // 25 texels: 0.2 at best
}

TEST(SmoothHeights, TrustsTheTexelsWithABetterScore) {
  constexpr int kSide = 9;
  std::vector<float> height = flat(kSide, 0.0f), score = flat(kSide, 0.9f);
  height[at(4, 4, kSide)] = 0.1f;
  score[at(4, 4, kSide)] = 0.1f;
  EXPECT_LT(smoothHeights(height, score, kSide, 1.0)[at(4, 4, kSide)], 0.005f);
}

TEST(UpsampleHeights, ReproducesAPlaneExactlyApronIncluded) {
  constexpr int kTexels = 16, kApron = 6, kCoarse = kTexels + 2 * kApron, kFine = 2 * kTexels + 2 * kApron;
  const auto plane = [](double x, double y) { return static_cast<float>(3 + 0.25 * x - 0.5 * y); };
  std::vector<float> coarse = flat(kCoarse, 0.0f);
  for (int y = 0; y < kCoarse; ++y)
    for (int x = 0; x < kCoarse; ++x)
      coarse[at(x, y, kCoarse)] = plane(2 * (x - kApron + 0.5), 2 * (y - kApron + 0.5));
  const std::vector<float> fine = upsampleHeights(coarse, kTexels, kApron);
  ASSERT_EQ(fine.size(), static_cast<std::size_t>(kFine * kFine));
  for (int y = 0; y < kFine; ++y)
    for (int x = 0; x < kFine; ++x)
      ASSERT_NEAR(fine[at(x, y, kFine)], plane(x - kApron + 0.5, y - kApron + 0.5), 1e-4) << x << ", " << y;
}

TEST(UpsampleBounds, EncloseTheUpsampledSurface) {
  constexpr int kTexels = 16, kApron = 5, kCoarse = kTexels + 2 * kApron;
  std::mt19937 random(3);
  std::uniform_real_distribution<float> any(-10.0f, 10.0f);
  std::vector<float> coarse = flat(kCoarse, 0.0f);
  for (float& h : coarse) h = any(random);
  const std::vector<float> fine = upsampleHeights(coarse, kTexels, kApron);
  const HeightBounds bounds = upsampleBounds(coarse, kTexels, kApron);
  ASSERT_EQ(bounds.low.size(), fine.size());
  for (std::size_t i = 0; i < fine.size(); ++i) {
    ASSERT_LE(bounds.low[i], fine[i] + 1e-4f) << i;
    ASSERT_GE(bounds.high[i], fine[i] - 1e-4f) << i;
  }
}

TEST(RemoveIslands, TakesSmallSpikesAndLeavesRoofsSlopesAndHoles) {
  constexpr int kSide = 40;
  std::vector<float> height = flat(kSide, 0.0f);
  const auto fill = [&](int x0, int y0, int x1, int y1, float value) {
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) height[at(x, y, kSide)] = value;
  };
  fill(2, 2, 5, 5, 8.0f);       // 9 texels: a spike
  fill(30, 4, 34, 8, -6.0f);    // 16 texels: a dent
  fill(10, 10, 20, 20, 10.0f);  // 100 texels: a roof
  fill(25, 25, 28, 28, 0.4f);   // 9 texels, but it connects with the ground
  height[at(36, 36, kSide)] = kNaN;
  removeIslands(height, kSide, 0.5, 40);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const bool spike = x >= 2 && x < 5 && y >= 2 && y < 5, dent = x >= 30 && x < 34 && y >= 4 && y < 8;
      const bool hole = x == 36 && y == 36;
      ASSERT_EQ(std::isnan(height[at(x, y, kSide)]), spike || dent || hole) << x << ", " << y;
    }
}

TEST(FillHoles, InterpolatesASmallHoleAndMarksIt) {
  constexpr int kSide = 24;
  std::vector<float> height = flat(kSide, 0.0f);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) height[at(x, y, kSide)] = 0.01f * static_cast<float>(x);
  std::vector<std::uint8_t> filled(height.size(), 0);
  for (int y = 10; y < 13; ++y)
    for (int x = 10; x < 13; ++x) height[at(x, y, kSide)] = kNaN;
  fillHoles(height, filled, kSide, 9, 0.5);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const bool hole = x >= 10 && x < 13 && y >= 10 && y < 13;
      EXPECT_EQ(filled[at(x, y, kSide)], hole ? 1 : 0);
      EXPECT_NEAR(height[at(x, y, kSide)], 0.01f * static_cast<float>(x), hole ? 0.015 : 0);
    }
}

// A town on a slope, a tenth of a metre a texel: what is removed is what nothing as wide as a fifth of its
// height holds up.
TEST(RemoveNeedles, TakesWhatIsFarHigherThanWideAndLeavesTheTown) {
  constexpr int kSide = 300;
  constexpr double kTexel_m = 0.1;
  std::vector<float> height(flat(kSide, 0.0f));
  std::vector<std::uint8_t> needle(height.size(), 0);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      float& h = height[at(x, y, kSide)];
      h = 0.05f * static_cast<float>(x);
      const auto within = [&](int x0, int y0, int width, int depth) {
        return x >= x0 && x < x0 + width && y >= y0 && y < y0 + depth;
      };
      if (within(20, 20, 90, 70)) h += 40;                     // a tower
      if (std::abs(x - 200) + std::abs(y - 70) < 60) h += 40;  // one that is turned: its corners, too
      if (within(20, 150, 200, 3)) h += 2;                     // a wall
      if (std::hypot(x - 150, y - 200) < 20) h += 12;          // a tree
      if (within(200, 200, 80, 80) && x % 9 != 0) h += 30;     // a roof with stripes of holes
      const bool pole = within(60, 240, 6, 6), lump = within(110, 40, 50, 50), on_roof = within(50, 40, 5, 5);
      if (pole) h += 25;
      if (lump) h += 70;  // beside the tower, 30 m above it
      if (on_roof) h += 20;
      needle[at(x, y, kSide)] = pole || lump || on_roof ? 1 : 0;
    }
  std::vector<float> closed = height;
  for (int y = 200; y < 280; ++y)
    for (int x = 200; x < 280; ++x)
      if (x % 9 == 0) {
        height[at(x, y, kSide)] = kNaN;
        closed[at(x, y, kSide)] = height[at(x + 1, y, kSide)];
      }
  std::vector<float> left = height;
  removeNeedles(left, closed, kSide, kTexel_m);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const std::size_t i = at(x, y, kSide);
      if (needle[i] != 0) {
        ASSERT_TRUE(std::isnan(left[i])) << x << ", " << y;
      } else if (!std::isnan(height[i])) {
        ASSERT_EQ(left[i], height[i]) << x << ", " << y;
      }
    }
}

TEST(RemoveNeedles, DoesNothingToLevelGroundOrNoGround) {
  for (const float value : {3.0f, kNaN}) {
    std::vector<float> height = flat(40, value);
    const std::vector<float> closed = height;
    removeNeedles(height, closed, 40, 0.1);
    for (const float h : height) EXPECT_EQ(std::isnan(h), std::isnan(value));
  }
}

TEST(FillHoles, BesideAWallTheGroundGoesOnAndNoRampComes) {
  constexpr int kSide = 24;
  std::vector<float> height = flat(kSide, 2.0f);
  for (int y = 0; y < kSide; ++y)
    for (int x = 12; x < kSide; ++x) height[at(x, y, kSide)] = 12.0f;
  std::vector<std::uint8_t> filled(height.size(), 0);
  for (int y = 8; y < 16; ++y)
    for (int x = 9; x < 12; ++x) height[at(x, y, kSide)] = kNaN;
  fillHoles(height, filled, kSide, 100, 0.5);
  for (int y = 8; y < 16; ++y)
    for (int x = 9; x < 12; ++x) EXPECT_FLOAT_EQ(height[at(x, y, kSide)], 2.0f);
}

TEST(FillHoles, LeavesLargeHolesAndThoseAtTheBorder) {
  constexpr int kSide = 24;
  std::vector<float> height = flat(kSide, 2.0f);
  std::vector<std::uint8_t> filled(height.size(), 0);
  height[at(0, 5, kSide)] = height[at(1, 5, kSide)] = kNaN;
  for (int y = 10; y < 14; ++y)
    for (int x = 10; x < 14; ++x) height[at(x, y, kSide)] = kNaN;
  fillHoles(height, filled, kSide, 15, 0.5);
  EXPECT_TRUE(std::isnan(height[at(1, 5, kSide)]));
  EXPECT_TRUE(std::isnan(height[at(12, 12, kSide)]));
  EXPECT_EQ(std::count(filled.begin(), filled.end(), 1), 0);
}

}  // namespace
}  // namespace overfly::tiling
