#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "render/amplify/land_cover.h"
#include "render/amplify/plant.h"
#include "render/amplify/seed_patterns.h"

namespace overfly::amplify {

// How a species grows where the land cover names it.
struct SpeciesRule {
  int seeds_per_tile = 0;  // the first so many seeds of a pattern take root; at most SeedPatterns::kSeeds
  float least_height_m = 0;
  float greatest_height_m = 0;
  float radius_per_height = 0;  // of the crown
  float steepest = 1.0f;        // rise per metre beyond which nothing grows
  float highest_m = 1e9f;       // of the ground, scene ENU
};

// Everything that decides where plants stand and what they are like. No plant is stored: a plant is a
// function of its tile, its seed and these values (Amara et al., 4.4), the same for the truth, the ray-tracer
// and the GPU's selection. Value type, reentrant.
struct Population {
  std::uint32_t seed = 1;
  SeedPatterns patterns{1};
  LandCover cover;
  std::array<SpeciesRule, 4> rules;  // by species

  // Tiles whose squares touch the land cover.
  struct TileRange {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // half open
  };
  [[nodiscard]] TileRange tiles() const;
};

struct GroundPoint {
  float up = 0;     // metres
  float steep = 0;  // rise per metre
};
using GroundAt = std::function<GroundPoint(float east, float north)>;

// The plant that seed `index` of a tile becomes; species None where it does not take root.
[[nodiscard]] Plant plantOf(const Population& population, int tile_x, int tile_y, int index,
                            const GroundAt& ground);

// All of them, tile after tile, seed after seed.
[[nodiscard]] std::vector<Plant> allPlants(const Population& population, const GroundAt& ground);

}  // namespace overfly::amplify
