#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "tests/stress/hard_case/hard_case.h"
#include "tiling/clipmap/parent.h"
#include "tiling/store/codec_heights.h"

// No-data beside data, in every share from one hole to one texel that is left.
namespace overfly::tiling {
namespace {

constexpr int kSize = 32;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr double kShares[] = {0.001, 0.05, 0.5, 0.95, 0.999};

std::vector<float> heightsWithHoles(std::mt19937& random, double holes) {
  std::vector<float> heights(kSize * kSize);
  std::uniform_real_distribution<float> height(-500, 9000);
  std::bernoulli_distribution hole(holes);
  for (float& h : heights) h = hole(random) ? kNan : height(random);
  return heights;
}

TEST(NoData, AParentAveragesWhatIsValid) {
  std::mt19937 random(1);
  double worst_m = 0, mistaken = 0;
  for (int round = 0; round < 200; ++round) {
    Tile child = Tile::blank({10, 0, 0}, kSize);
    child.elevation = heightsWithHoles(random, kShares[round % 5]);
    for (std::size_t i = 0; i < child.texels(); ++i)
      child.kind[i] = std::isnan(child.elevation[i]) ? kNoData : kMeasured;
    const Tile parent = makeParent({9, 0, 0}, {&child, nullptr, nullptr, nullptr});
    if (parent.empty()) {
      mistaken +=
          std::all_of(child.elevation.begin(), child.elevation.end(), [](float h) { return std::isnan(h); })
              ? 0
              : 1;
      continue;
    }
    for (int y = 0; y < kSize; ++y)
      for (int x = 0; x < kSize; ++x) {
        double sum = 0;
        int count = 0;
        for (int k = 0; k < 4 && x < kSize / 2 && y < kSize / 2; ++k) {
          const float h = child.elevation[static_cast<std::size_t>((2 * y + k / 2) * kSize + 2 * x + k % 2)];
          if (std::isnan(h)) continue;
          sum += h;
          ++count;
        }
        const float made = parent.elevation[static_cast<std::size_t>(y * kSize + x)];
        if (std::isnan(made) != (count == 0))
          ++mistaken;
        else if (count > 0)
          worst_m = std::max(worst_m, std::abs(static_cast<double>(made) - sum / count));
      }
  }
  test::expectAtMost("no-data/parent", "texels that are data where there is none, or the reverse", mistaken,
                     0);
  test::expectAtMost("no-data/parent", "metres off the mean of the valid ones", worst_m, 0.001);
}

TEST(NoData, TheCodecKeepsIt) {
  std::mt19937 random(2);
  double worst_steps = 0, mistaken = 0;
  for (int round = 0; round < 200; ++round) {
    const std::vector<float> heights = heightsWithHoles(random, kShares[round % 5]);
    HeightCoding coding;
    coding.step_m = 0.01;
    const auto bytes = encodeHeights(heights, kSize, coding);
    ASSERT_TRUE(bytes);
    const auto back = decodeHeights(*bytes, kSize);
    ASSERT_TRUE(back);
    for (std::size_t i = 0; i < heights.size(); ++i) {
      if (std::isnan(heights[i]) != std::isnan((*back)[i]))
        ++mistaken;
      else if (!std::isnan(heights[i]))
        worst_steps =
            std::max(worst_steps, std::abs(double{heights[i]} - double{(*back)[i]}) / coding.step_m);
    }
  }
  test::expectAtMost("no-data/codec", "texels that are data where there is none, or the reverse", mistaken,
                     0);
  test::expectAtMost("no-data/codec", "error in steps", worst_steps, 0.55);
}

}  // namespace
}  // namespace overfly::tiling
