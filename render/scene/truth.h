#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "capture/geo/tile_lattice.h"
#include "render/scene/appearance.h"
#include "render/scene/geometry.h"
#include "render/scene/ray_tracer.h"
#include "render/scene/world.h"

namespace overfly::scene {

struct TruthPoint {
  double height_m = 0;                   // ellipsoidal, of the highest surface
  std::array<std::uint8_t, 3> colour{};  // what a camera straight above would see, sunlit, without any effect
  Hit::Kind kind = Hit::Kind::Ground;
};

// One tile of truth, row 0 in the north; sampled at texel centres. NaN and transparent black outside the
// scene.
struct TruthTile {
  int size = 0;                     // texels a side
  std::vector<float> elevation;     // ellipsoidal metres
  std::vector<std::uint8_t> color;  // RGBA8
};

// What is really there: heights and colours of the scene at any place, from the triangles themselves (BVH, in
// double), along the ellipsoid's normal at the place; plants included, as LOD 0. Immutable; reentrant, so
// that several threads may ask.
class Truth {
 public:
  explicit Truth(std::shared_ptr<const World> world);

  // nullopt outside the scene's ground.
  [[nodiscard]] std::optional<double> heightAt(double lat, double lon) const;
  // `footprint_m`: side of the square over which the texture is filtered; with_shadows as sun_shadows would.
  [[nodiscard]] std::optional<TruthPoint> pointAt(double lat, double lon, double footprint_m,
                                                  bool with_shadows = false) const;

  // Elevation of the tile's texel centres; `with_color` adds the orthophoto, filtered over a texel.
  [[nodiscard]] TruthTile tile(const geo::TileLattice& lattice, const geo::TileKey& key, int size = 256,
                               bool with_color = true) const;

  [[nodiscard]] const World& world() const { return *world_; }
  [[nodiscard]] const Geometry& geometry() const { return geometry_; }

 private:
  [[nodiscard]] Ray rayDown(double lat, double lon) const;

  std::shared_ptr<const World> world_;
  Geometry geometry_;
  Appearance appearance_;
};

}  // namespace overfly::scene
