#include "tiling/adjust/features.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace overfly::tiling::adjust {
namespace {

// Round bright spots at known places between the pixels.
struct Spots {
  static constexpr int kWidth = 1600, kHeight = 1200;
  std::vector<Eigen::Vector2d> places;  // first pixel's centre at (0.5, 0.5)
  std::vector<std::uint8_t> bytes;

  Spots() {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> shift(-10, 10), size(3, 9);
    std::vector<double> light(static_cast<std::size_t>(kWidth) * kHeight, 40);
    for (int y = 60; y < kHeight - 60; y += 80)
      for (int x = 60; x < kWidth - 60; x += 80) {
        const Eigen::Vector2d at(x + shift(random), y + shift(random));
        const double sigma = size(random);
        places.push_back(at);
        for (int v = y - 40; v < y + 40; ++v)
          for (int u = x - 40; u < x + 40; ++u)
            light[static_cast<std::size_t>(v * kWidth + u)] +=
                160 *
                std::exp(-0.5 * (Eigen::Vector2d(u + 0.5, v + 0.5) - at).squaredNorm() / (sigma * sigma));
      }
    for (const double l : light) bytes.push_back(static_cast<std::uint8_t>(std::lround(l)));
  }
  // Found minus true place of the spots that were found, on average.
  [[nodiscard]] Eigen::Vector2d meanError(const FeatureOptions& options, int& found) const {
    const Features features = findFeatures({bytes.data(), kWidth, kHeight, kWidth}, options);
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    found = 0;
    for (const auto& place : places) {
      Eigen::Vector2d nearest(1e9, 1e9);
      for (const auto& pixel : features.pixels)
        if ((pixel - place).norm() < nearest.norm()) nearest = pixel - place;
      if (nearest.norm() > 3) continue;
      sum += nearest;
      ++found;
    }
    return sum / std::max(1, found);
  }
};

// A shift that all features have in common would become a wrong principal point: frames of legs that were
// flown in opposite directions then contradict each other by twice the shift.
TEST(Features, LieWhereThePictureHasThem) {
  const Spots spots;
  for (const int side : {1600, 800}) {
    FeatureOptions options;
    options.long_side_px = side;
    int found = 0;
    const Eigen::Vector2d error = spots.meanError(options, found);
    EXPECT_GT(found, 200) << side;
    EXPECT_LT(error.norm(), 0.05) << side << ": " << error.transpose();
  }
}

}  // namespace
}  // namespace overfly::tiling::adjust
