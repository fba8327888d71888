#include "render/amplify/selector.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <tuple>

namespace overfly::amplify {
namespace {

struct Hills {
  static constexpr int kCorners = 129;
  std::vector<float> heights;
  HeightGrid grid;
  Hills() {
    for (int y = 0; y < kCorners; ++y) {
      for (int x = 0; x < kCorners; ++x)
        heights.push_back(static_cast<float>(6 * std::sin(0.11 * x) * std::cos(0.07 * y)));
    }
    grid = {{-256, -256}, 4, kCorners, kCorners, heights};
  }
  [[nodiscard]] GroundPoint at(float east, float north) const {
    const auto height = [&](double e, double n) {
      const double u = std::clamp((e + 256) / 4, 0.0, kCorners - 1.0),
                   v = std::clamp((n + 256) / 4, 0.0, kCorners - 1.0);
      const int x = std::min(static_cast<int>(u), kCorners - 2),
                y = std::min(static_cast<int>(v), kCorners - 2);
      const auto corner = [&](int i, int k) {
        return double{heights[static_cast<std::size_t>(k * kCorners + i)]};
      };
      const double s = u - x, t = v - y, sw = corner(x, y), ne = corner(x + 1, y + 1);
      return s >= t ? sw + s * (corner(x + 1, y) - sw) + t * (ne - corner(x + 1, y))
                    : sw + t * (corner(x, y + 1) - sw) + s * (ne - corner(x, y + 1));
    };
    return {static_cast<float>(height(east, north)),
            static_cast<float>(std::hypot(height(east + 4, north) - height(east - 4, north),
                                          height(east, north + 4) - height(east, north - 4)) /
                               8)};
  }
};

Population mixedForest() {
  Population population;
  population.seed = 77;
  population.patterns = SeedPatterns(77);
  std::vector<Species> classes;
  for (int i = 0; i < 512 * 512; ++i) classes.push_back(static_cast<Species>((i / 7 + i / 512 / 5) % 4));
  population.cover = LandCover(-256, -256, 512, 512, classes);
  population.rules[1] = {60, 6, 14, 0.36f, 0.6f, 5};
  population.rules[2] = {40, 8, 18, 0.2f, 0.9f, 1000};
  population.rules[3] = {120, 1, 2, 0.5f, 2.0f, 1000};
  return population;
}

PlantView everything(const Eigen::Vector3d& eye) {
  PlantView view;
  view.eye = eye;
  view.planes.fill({0, 0, 1, 1e6});
  return view;
}

std::vector<Plant> download(const PlantSelector& selector, int bin, int count) {
  std::vector<Plant> plants(static_cast<std::size_t>(count));
  if (count > 0) {
    const auto read =
        selector.instances().download(std::span(plants), sizeof(Plant) * static_cast<std::size_t>(bin) *
                                                             static_cast<std::size_t>(selector.capacity()));
    EXPECT_TRUE(read);
  }
  return plants;
}

std::vector<Plant> allSelected(PlantSelector& selector, const PlantView& view) {
  const auto counts = selector.select(view);
  EXPECT_TRUE(counts);
  std::vector<Plant> plants;
  for (int bin = 0; counts && bin < kPlantBins; ++bin) {
    for (const Plant& plant : download(selector, bin, (*counts)[static_cast<std::size_t>(bin)]))
      plants.push_back(plant);
  }
  return plants;
}

auto bySeed() {
  return [](const Plant& a, const Plant& b) {
    return std::tie(a.seed, a.east, a.north) < std::tie(b.seed, b.east, b.north);
  };
}

TEST(PlantSelector, FindsThePlantsOfTheTruthAndNoOthers) {
  auto context = gl::Context::create();
  ASSERT_TRUE(context) << context.error().message;
  const Hills hills;
  const Population population = mixedForest();
  std::vector<Plant> truth = allPlants(population, [&](float e, float n) { return hills.at(e, n); });
  ASSERT_GT(truth.size(), 10000u);
  auto selector = PlantSelector::create(*context, population, hills.grid, 30000);
  ASSERT_TRUE(selector) << selector.error().message;
  std::vector<Plant> found = allSelected(*selector, everything({0, 0, 100}));
  std::sort(truth.begin(), truth.end(), bySeed());
  std::sort(found.begin(), found.end(), bySeed());
  // Steepness and height decide at a threshold in float here and in double there: a few in ten thousand
  // differ.
  std::vector<Plant> both;
  std::set_intersection(truth.begin(), truth.end(), found.begin(), found.end(), std::back_inserter(both),
                        bySeed());
  EXPECT_GT(both.size() + 5, std::max(truth.size(), found.size()));
  for (const Plant& plant : found) {
    const auto match = std::lower_bound(truth.begin(), truth.end(), plant, bySeed());
    if (match == truth.end() || bySeed()(plant, *match)) continue;  // counted above
    EXPECT_NEAR(plant.up, match->up, 1e-3);
    EXPECT_NEAR(plant.height, match->height, 1e-4);
    EXPECT_NEAR(plant.radius, match->radius, 1e-4);
    EXPECT_EQ(plant.species, match->species);
  }
  EXPECT_TRUE(context->takeErrors().empty());
}

TEST(PlantSelector, CullsByTheViewAndSortsIntoRings) {
  auto context = gl::Context::create();
  ASSERT_TRUE(context);
  const Hills hills;
  const Population population = mixedForest();
  auto selector = PlantSelector::create(*context, population, hills.grid, 30000);
  ASSERT_TRUE(selector);
  PlantView view = everything({0, 0, 60});
  view.planes[0] = {1, 0, 0, 0};  // east of the origin only
  view.rings = {100, 150, 220};
  const auto counts = selector->select(view);
  ASSERT_TRUE(counts);
  const std::vector<Plant> truth = allPlants(population, [&](float e, float n) { return hills.at(e, n); });
  std::size_t drawn = 0;
  for (int bin = 0; bin < kPlantBins; ++bin) {
    for (const Plant& plant : download(*selector, bin, (*counts)[static_cast<std::size_t>(bin)])) {
      const double away =
          (Eigen::Vector3d(plant.east, plant.north, plant.up + 0.5 * plant.height) - view.eye).norm();
      EXPECT_EQ(static_cast<int>(plant.species) - 1, bin / 3);
      EXPECT_GE(away + 1e-3, bin % 3 == 0 ? 0 : view.rings[bin % 3 - 1]);
      EXPECT_LE(away - 1e-3, view.rings[bin % 3]);
      EXPECT_GT(plant.east, -15);  // no crown of these rules reaches farther
      ++drawn;
    }
  }
  std::size_t wanted = 0;  // surely inside
  for (const Plant& plant : truth) {
    wanted +=
        plant.east > 0 &&
                (Eigen::Vector3d(plant.east, plant.north, plant.up + 0.5 * plant.height) - view.eye).norm() <
                    219.9
            ? 1
            : 0;
  }
  EXPECT_GT(wanted, 1000u);
  EXPECT_GE(drawn + 3, wanted);
  EXPECT_LT(static_cast<double>(drawn), 1.2 * static_cast<double>(wanted));
}

TEST(PlantSelector, OrderIsTheSameOnEveryRun) {
  const Hills hills;
  const Population population = mixedForest();
  std::vector<Plant> first;
  for (int run = 0; run < 2; ++run) {
    auto context = gl::Context::create();
    ASSERT_TRUE(context);
    auto selector = PlantSelector::create(*context, population, hills.grid, 30000);
    ASSERT_TRUE(selector);
    const std::vector<Plant> plants = allSelected(*selector, everything({10, 20, 50}));
    if (run == 0) first = plants;
    EXPECT_EQ(plants, first);
  }
}

}  // namespace
}  // namespace overfly::amplify
