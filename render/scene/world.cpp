#include "render/scene/world.h"

#include <algorithm>
#include <cmath>

#include "render/scene/detail/settlement.h"
#include "render/scene/random.h"

namespace overfly::scene {
namespace {

constexpr double kChunkMetres = 12;

// Land-cover classes on 1 m texels. Where several kinds of plants share the ground, each texel belongs to one
// of them, by chance in proportion to their densities.
amplify::LandCover landCover(const World& world, const std::vector<Footprint2>& taken) {
  const SceneDescription& scene = world.description;
  if (scene.vegetation.empty()) return {};
  const Eigen::Vector2d low = world.terrain.west_south(), high = world.terrain.east_north();
  const int width = static_cast<int>(std::floor((high.x() - low.x()) / 2)) * 2;
  const int height = static_cast<int>(std::floor((high.y() - low.y()) / 2)) * 2;
  const auto cells = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  std::vector<std::uint8_t> blocked(cells, 0);
  for (const Footprint2& footprint : taken) {
    constexpr double kMargin = 1.8;
    const double reach = footprint.half.norm() + kMargin;
    const Eigen::Vector2d from = footprint.centre - low - Eigen::Vector2d::Constant(reach);
    for (int y = std::max(0, static_cast<int>(from.y()));
         y < std::min(height, static_cast<int>(from.y() + 2 * reach) + 1); ++y) {
      for (int x = std::max(0, static_cast<int>(from.x()));
           x < std::min(width, static_cast<int>(from.x() + 2 * reach) + 1); ++x) {
        const Eigen::Vector2d p = low + Eigen::Vector2d(x + 0.5, y + 0.5);
        if (footprint.distance(p) < kMargin)
          blocked[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                  static_cast<std::size_t>(x)] = 1;
      }
    }
  }
  const std::uint32_t seed = seedOf(scene.seed, "land cover");
  std::vector<amplify::Species> classes(cells, amplify::Species::None);
  for (std::size_t i = 0; i < cells; ++i) {
    const int x = static_cast<int>(i % static_cast<std::size_t>(width)),
              y = static_cast<int>(i / static_cast<std::size_t>(width));
    const Eigen::Vector2d p = low + Eigen::Vector2d(x + 0.5, y + 0.5);
    if (blocked[i] || world.cover.streetDistance(p) > -(scene.pavement + 0.7) ||
        world.cover.pavedDistance(p) > -0.6)
      continue;
    const Base base = world.cover.baseAt(p);
    double total = 0;
    for (const VegetationDescription& plants : scene.vegetation) {
      if ((!plants.on || *plants.on == base) && (plants.polygon.empty() || insidePolygon(p, plants.polygon)))
        total += plants.per_hectare;
    }
    double pick = total * uniform(seed, static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y));
    for (const VegetationDescription& plants : scene.vegetation) {
      if (!((!plants.on || *plants.on == base) &&
            (plants.polygon.empty() || insidePolygon(p, plants.polygon))))
        continue;
      if ((pick -= plants.per_hectare) < 0) {
        classes[i] = static_cast<amplify::Species>(plants.species);
        break;
      }
    }
  }
  return {low.x(), low.y(), width, height, classes};
}

void growPlants(World& world, const std::vector<Footprint2>& taken) {
  const SceneDescription& scene = world.description;
  amplify::Population& population = world.population;
  population.seed = seedOf(scene.seed, "plants");
  population.patterns = amplify::SeedPatterns(population.seed);
  population.cover = landCover(world, taken);
  constexpr double kHectare = 10000.0,
                   kTileArea = amplify::SeedPatterns::kTileMetres * amplify::SeedPatterns::kTileMetres;
  constexpr float kRadius[4] = {0, 0.36f, 0.21f, 0.55f};
  // A species' density where it shares the ground is the sum of what grows there: its texels are only its
  // share.
  double total = 0;
  for (const VegetationDescription& plants : scene.vegetation) total += plants.per_hectare;
  for (const VegetationDescription& plants : scene.vegetation) {
    const auto species = static_cast<std::size_t>(plants.species);
    amplify::SpeciesRule& rule = population.rules[species];
    const bool shares = std::any_of(
        scene.vegetation.begin(), scene.vegetation.end(), [&](const VegetationDescription& other) {
          return &other != &plants && other.on == plants.on && other.polygon == plants.polygon;
        });
    const double density = shares ? total : plants.per_hectare;
    rule.seeds_per_tile = std::clamp(static_cast<int>(std::lround(density * kTileArea / kHectare)),
                                     rule.seeds_per_tile, amplify::SeedPatterns::kSeeds);
    rule.least_height_m = static_cast<float>(plants.height.x());
    rule.greatest_height_m = static_cast<float>(plants.height.y());
    rule.radius_per_height = kRadius[species];
  }
  world.plants =
      amplify::allPlants(population, [&](float east, float north) { return world.groundAt(east, north); });
}

}  // namespace

amplify::GroundPoint World::groundAt(float east, float north) const {
  return {static_cast<float>(terrain.heightAt(east, north)),
          static_cast<float>(terrain.steepnessAt(east, north))};
}

Result<std::shared_ptr<const World>> buildWorld(const SceneDescription& description) {
  Result<Terrain> terrain = Terrain::make(description.terrain, description.seed);
  if (!terrain) return tl::unexpected<Error>(terrain.error());
  auto world = std::make_shared<World>(World{
      description, geo::LocalFrame(description.place), std::move(*terrain), {}, {}, {}, {}, {}, {0, 0, 1}});
  const double cosine = std::cos(description.sun.elevation);
  world->towards_sun = {cosine * std::sin(description.sun.azimuth),
                        cosine * std::cos(description.sun.azimuth), std::sin(description.sun.elevation)};
  const Eigen::Vector2d low = world->terrain.west_south(), high = world->terrain.east_north();
  const double texel = std::max(0.25, (high - low).maxCoeff() / 4096);
  world->cover = CoverMap(low, high, texel, description.base);
  for (const AreaDescription& area : description.areas) world->cover.paintArea(area.polygon, area.base);
  for (const StreetDescription& street : description.streets)
    world->cover.paintStreet(street.points, street.width);
  SolidBuilder solids;
  Site site{description, world->terrain, solids, world->cover, {}};
  buildBuildings(site);
  if (description.city) buildCity(site, *description.city);
  if (description.canyon) buildCanyon(site, *description.canyon);
  buildSettlement(site);
  world->ground = world->terrain.mesh(kChunkMetres);
  world->solids = std::move(solids).finish(kChunkMetres);
  growPlants(*world, site.taken);
  return std::shared_ptr<const World>(std::move(world));
}

}  // namespace overfly::scene
