#pragma once
// Rays on the GPU against the reference in double, which marches every cell of the finest level.
#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "render/preview/height_grid.h"
#include "render/preview/ray_caster.h"
#include "tests/unit/preview/synthetic_map.h"

namespace overfly::preview {

using test::SyntheticMap;

// A map whose level 0 is in GPU memory as a whole.
struct Scene {
  Scene(gl::Context& context, const SyntheticMap::Options& options, const SyntheticMap::Height& height)
      : map(options, height), ram(map), caster(context) {
    // Straight down from where all of the map is in the picture, in few pixels: for the caches.
    View view;
    view.position = map.place(0.5 * map.texels(), 0.5 * map.texels(), 900);
    view.pitch = -1.5707963;
    view.width = view.height = 16384;
    const auto made = Domain::create(*map.extent());
    domain = *made;
    textures = MapTextures::create(context, options.tile_size, 400).value();
    cache = std::make_unique<ClipCache>(
        domain, ram, *textures, ClipCache::Options{{16, 1, 400}, NoData::Hole, LoadOrder::DetailFirst});
    for (int i = 0; i < 3; ++i) {
      const auto frame = RayFrame::create(domain, view.position, 447).value();
      static_cast<void>(cache->update(focusOf(view, frame, domain, 447), {}));
      while (ram.loadNext()) {
      }
    }
    static_cast<void>(textures->uploadTable(context, *cache));
    grid = std::make_unique<HeightGrid>(HeightGrid::load(domain, map, 0).value());
  }
  SyntheticMap map;
  RamCache ram;
  Domain domain = Domain::create({}).value_or(Domain{});
  std::unique_ptr<MapTextures> textures;
  std::unique_ptr<ClipCache> cache;
  std::unique_ptr<HeightGrid> grid;
  RayCaster caster;
};

struct Agreement {
  std::size_t rays = 0, hits = 0;
  std::size_t other_end = 0;  // one hits, the other does not
  std::size_t beyond = 0;     // hit heights differ by more than 1 mm
  std::size_t gave_up = 0;
  int most_steps = 0;
  double worst_m = 0;
  Agreement& operator+=(const Agreement& o) {
    rays += o.rays;
    hits += o.hits;
    other_end += o.other_end;
    beyond += o.beyond;
    gave_up += o.gave_up;
    most_steps = std::max(most_steps, o.most_steps);
    worst_m = std::max(worst_m, o.worst_m);
    return *this;
  }
};

// Rays of one of these kinds, drawn at random: 0 anything, 1 along an axis, 2 along cell borders, 3 grazing
// at 0.01 degrees, 4 upwards, 5 from inside and below the terrain, 6 from 10 km, 7 towards the horizon, 8
// with components that are zero, 9 from a cell's edge or corner.
inline constexpr int kRayKinds = 10;
[[nodiscard]] std::vector<SingleRay> randomRays(std::uint64_t seed, int kind, std::size_t count,
                                                const Scene& scene, const RayFrame& frame);
[[nodiscard]] Agreement compare(Scene& scene, const RayFrame& frame, Surface surface,
                                std::span<const SingleRay> rays);
// Prints a line.
void report(Surface surface, const std::string& kind, const Agreement& agreement);

}  // namespace overfly::preview
