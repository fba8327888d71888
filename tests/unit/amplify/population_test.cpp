#include "render/amplify/population.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace overfly::amplify {
namespace {

GroundPoint flat(float, float) { return {}; }

Population forest(int seeds_per_tile, std::uint32_t seed = 5) {
  Population population;
  population.seed = seed;
  population.patterns = SeedPatterns(seed);
  population.cover = LandCover(-128, -128, 256, 256, std::vector<Species>(256 * 256, Species::Broadleaf));
  population.rules[1] = {seeds_per_tile, 4, 12, 0.35f, 1.0f, 1000};
  return population;
}

TEST(ParkMiller, IsTheMinimalStandardGenerator) {
  std::uint32_t state = 1;
  for (int i = 0; i < 10000; ++i) state = parkMiller(state);
  EXPECT_EQ(state, 1043618065u);  // Park and Miller 1988: the check value after 10,000 steps from 1
}

TEST(SeedPatterns, EveryPrefixIsSpreadBetterThanChance) {
  const SeedPatterns patterns(3);
  for (const int count : {8, 32, 128}) {
    double mean = 0;
    for (int pattern = 0; pattern < SeedPatterns::kPatterns; ++pattern) {
      double nearest_sum = 0;
      for (int i = 0; i < count; ++i) {
        double nearest = 1;
        for (int k = 0; k < count; ++k) {
          if (k == i) continue;
          double dx = std::abs(patterns.at(pattern, i).x - patterns.at(pattern, k).x) / 65536.0;
          double dy = std::abs(patterns.at(pattern, i).y - patterns.at(pattern, k).y) / 65536.0;
          dx = std::min(dx, 1 - dx);
          dy = std::min(dy, 1 - dy);
          nearest = std::min(nearest, std::hypot(dx, dy));
        }
        nearest_sum += nearest;
      }
      mean += nearest_sum / count / SeedPatterns::kPatterns;
    }
    EXPECT_GT(mean, 1.2 * 0.5 / std::sqrt(count)) << count;  // 0.5 / sqrt(n) is what chance gives
  }
}

TEST(SeedPatterns, AreLaidWithoutAPeriod) {
  std::set<int> used;
  for (int i = 0; i < 256; ++i) used.insert(SeedPatterns::patternOf(i % 16, i / 16, 9));
  EXPECT_EQ(used.size(), static_cast<std::size_t>(SeedPatterns::kPatterns));
  for (int period = 1; period <= 64; ++period) {
    int same = 0;
    for (int x = 0; x < 256; ++x)
      same += SeedPatterns::patternOf(x, 0, 9) == SeedPatterns::patternOf(x + period, 0, 9) ? 1 : 0;
    EXPECT_LT(same, 64) << "period " << period;  // 16 expected of 256
  }
}

TEST(LandCover, AllLevelsAgreeAndPackAsInFigure1) {
  std::vector<Species> classes;
  for (int i = 0; i < 64; ++i) classes.push_back(static_cast<Species>((i * 7 + i / 8) % 4));
  const LandCover cover(100, 200, 8, 8, classes);
  for (double y = 200.25; y < 208; y += 0.5) {
    for (double x = 100.25; x < 108; x += 0.5) {
      const Species level1 =
          classes[static_cast<std::size_t>(static_cast<int>(y - 200) * 8 + static_cast<int>(x - 100))];
      for (int level = 0; level < LandCover::kLevels; ++level)
        EXPECT_EQ(cover.at(x, y, level), level1) << x << " " << y << " " << level;
    }
  }
  EXPECT_EQ(cover.texels(0).size(), 256u);
  EXPECT_EQ(cover.texels(2).size(), 16u);
  EXPECT_EQ(cover.at(99.9, 204), Species::None);
  EXPECT_EQ(cover.at(108, 204), Species::None);
}

TEST(Population, HasTheDensityAskedForAndIsTheSameEveryTime) {
  const Population population = forest(61);  // 600 per hectare
  const std::vector<Plant> plants = allPlants(population, flat);
  EXPECT_EQ(plants.size(), 61u * 64u);
  EXPECT_EQ(plants, allPlants(population, flat));
  EXPECT_NE(plants, allPlants(forest(61, 6), flat));
  for (const Plant& plant : plants) {
    EXPECT_GE(plant.height, 4);
    EXPECT_LE(plant.height, 12);
  }
}

TEST(Population, ThinnerForestIsASubsetOfTheThicker) {
  const std::vector<Plant> thin = allPlants(forest(10), flat), thick = allPlants(forest(40), flat);
  for (const Plant& plant : thin) EXPECT_NE(std::find(thick.begin(), thick.end(), plant), thick.end());
}

TEST(Population, RefusesBareSteepAndHighGround) {
  Population population = forest(61);
  EXPECT_TRUE(allPlants(population, [](float, float) { return GroundPoint{0, 1.5f}; }).empty());
  EXPECT_TRUE(allPlants(population, [](float, float) { return GroundPoint{1001, 0}; }).empty());
  population.cover = LandCover(-128, -128, 256, 256, std::vector<Species>(256 * 256, Species::None));
  EXPECT_TRUE(allPlants(population, flat).empty());
}

}  // namespace
}  // namespace overfly::amplify
