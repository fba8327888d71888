#include "render/scene/truth.h"

#include <cmath>
#include <limits>

namespace overfly::scene {
namespace {

constexpr double kAbove = 3000;   // metres over the place's height: rays start there
constexpr double kLength = 9000;  // and end so far below

}  // namespace

Truth::Truth(std::shared_ptr<const World> world)
    : world_(std::move(world)),
      geometry_(*world_),
      appearance_(world_->cover, world_->description.pavement, world_->description.street_lines) {}

Ray Truth::rayDown(double lat, double lon) const {
  const double top = world_->description.place.height_m + kAbove;
  const Eigen::Vector3d from = world_->local.enuFromEcef(geo::ecefFromGeodetic({lat, lon, top}));
  const Eigen::Vector3d to = world_->local.enuFromEcef(geo::ecefFromGeodetic({lat, lon, top - 1000}));
  return {from, (to - from) / 1000};
}

std::optional<double> Truth::heightAt(double lat, double lon) const {
  const std::optional<Hit> hit = geometry_.firstHit(rayDown(lat, lon), 0, kLength);
  if (!hit) return std::nullopt;
  return world_->description.place.height_m + kAbove - hit->distance;
}

std::optional<TruthPoint> Truth::pointAt(double lat, double lon, double footprint_m,
                                         bool with_shadows) const {
  const Ray ray = rayDown(lat, lon);
  const std::optional<Hit> hit = geometry_.firstHit(ray, 0, kLength);
  if (!hit) return std::nullopt;
  const Eigen::Vector3d point = ray.origin + hit->distance * ray.direction;
  const Facet facet = geometry_.facetOf(*hit);
  // The footprint's sides, projected along the ray onto the surface.
  const auto side = [&](const Eigen::Vector3d& along) {
    return Eigen::Vector3d(along - along.dot(facet.normal) / ray.direction.dot(facet.normal) * ray.direction);
  };
  const Shader shader{geometry_, appearance_, with_shadows};
  const glsl::vec3 colour = shader.colour(*hit, point, side({footprint_m, 0, 0}), side({0, footprint_m, 0}));
  const auto byte = [](float v) { return static_cast<std::uint8_t>(std::lround(255.0f * v)); };
  return TruthPoint{world_->description.place.height_m + kAbove - hit->distance,
                    {byte(colour.x), byte(colour.y), byte(colour.z)},
                    hit->kind};
}

TruthTile Truth::tile(const geo::TileLattice& lattice, const geo::TileKey& key, int size,
                      bool with_color) const {
  const auto texels = static_cast<std::size_t>(size) * static_cast<std::size_t>(size);
  TruthTile tile{size, std::vector<float>(texels, std::numeric_limits<float>::quiet_NaN()), {}};
  if (with_color) tile.color.assign(4 * texels, 0);
  const geo::Geodetic middle = lattice.geodeticFromPlane(geo::TileLattice::planeOf(key, 0.5, 0.5));
  const double texel_m = lattice.texelSize(key.zoom, middle.lat, middle.lon, size);
  std::size_t at = 0;
  for (int v = 0; v < size; ++v) {
    for (int u = 0; u < size; ++u, ++at) {
      const geo::Geodetic place =
          lattice.geodeticFromPlane(geo::TileLattice::planeOf(key, (u + 0.5) / size, (v + 0.5) / size));
      if (!with_color) {
        if (const std::optional<double> height = heightAt(place.lat, place.lon))
          tile.elevation[at] = static_cast<float>(*height);
        continue;
      }
      const std::optional<TruthPoint> point = pointAt(place.lat, place.lon, texel_m);
      if (!point) continue;
      tile.elevation[at] = static_cast<float>(point->height_m);
      for (std::size_t c = 0; c < 3; ++c) tile.color[4 * at + c] = point->colour[c];
      tile.color[4 * at + 3] = 255;
    }
  }
  return tile;
}

}  // namespace overfly::scene
