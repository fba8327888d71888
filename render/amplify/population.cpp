#include "render/amplify/population.h"

#include <cmath>

namespace overfly::amplify {
namespace {

constexpr std::uint32_t mixBits(std::uint32_t h) {
  h ^= h >> 15;
  h *= 0x2c1b3c6du;
  h ^= h >> 12;
  h *= 0x297a2d39u;
  h ^= h >> 15;
  return h;
}

// Uniform in [0, 1) with 24 bits, exact in float32 as in the shader.
float unitOf(std::uint32_t h) { return static_cast<float>(h >> 8) * 5.9604644775390625e-8f; }

}  // namespace

Population::TileRange Population::tiles() const {
  const auto tile = [](double metres) {
    return static_cast<int>(std::floor(metres / SeedPatterns::kTileMetres));
  };
  if (cover.width(1) == 0) return {};
  return {tile(cover.west()), tile(cover.south()), tile(cover.west() + cover.width(1) - 1e-6) + 1,
          tile(cover.south() + cover.height(1) - 1e-6) + 1};
}

Plant plantOf(const Population& population, int tile_x, int tile_y, int index, const GroundAt& ground) {
  const PatternSeed& seed =
      population.patterns.at(SeedPatterns::patternOf(tile_x, tile_y, population.seed), index);
  constexpr auto kTile = static_cast<float>(SeedPatterns::kTileMetres);
  Plant plant;
  plant.east = (static_cast<float>(tile_x) + static_cast<float>(seed.x) * (1.0f / 65536.0f)) * kTile;
  plant.north = (static_cast<float>(tile_y) + static_cast<float>(seed.y) * (1.0f / 65536.0f)) * kTile;
  const Species species = population.cover.at(plant.east, plant.north);
  const SpeciesRule& rule = population.rules[static_cast<std::size_t>(species)];
  if (species == Species::None || index >= rule.seeds_per_tile) return {};
  const GroundPoint at = ground(plant.east, plant.north);
  if (at.steep > rule.steepest || at.up > rule.highest_m) return {};
  plant.up = at.up;
  plant.species = static_cast<std::uint32_t>(species);
  plant.seed = mixBits((static_cast<std::uint32_t>(tile_x) * 0x9e3779b1u) ^
                       (static_cast<std::uint32_t>(tile_y) * 0x85ebca77u) ^
                       (static_cast<std::uint32_t>(index) * 0xc2b2ae3du) ^ population.seed);
  const float size = unitOf(mixBits(plant.seed + 1u));
  plant.height = rule.least_height_m + (rule.greatest_height_m - rule.least_height_m) * size;
  plant.radius = plant.height * rule.radius_per_height * (0.8f + 0.4f * unitOf(mixBits(plant.seed + 2u)));
  plant.turn = 6.2831853f * unitOf(mixBits(plant.seed + 3u));
  return plant;
}

std::vector<Plant> allPlants(const Population& population, const GroundAt& ground) {
  std::vector<Plant> plants;
  const Population::TileRange range = population.tiles();
  for (int y = range.y0; y < range.y1; ++y) {
    for (int x = range.x0; x < range.x1; ++x) {
      for (int index = 0; index < SeedPatterns::kSeeds; ++index) {
        const Plant plant = plantOf(population, x, y, index, ground);
        if (plant.species != 0) plants.push_back(plant);
      }
    }
  }
  return plants;
}

}  // namespace overfly::amplify
