#include "render/preview/domain.h"

#include <bit>
#include <cmath>

namespace overfly::preview {

Result<Domain> Domain::create(const MapExtent& extent) {
  if (!(extent.max.x() > extent.min.x()) || !(extent.max.y() > extent.min.y()))
    return fail(ErrorCode::BadInput, "the map covers no area yet");
  if (extent.tile_size < 8 || !std::has_single_bit(static_cast<unsigned>(extent.tile_size)))
    return fail(ErrorCode::BadInput, "the preview needs tiles of a power of two texels, at least 8");
  Domain domain;
  domain.lattice_ = extent.lattice;
  domain.tile_size_ = extent.tile_size;
  const geo::TileKey first = geo::TileLattice::keyAt(extent.min, extent.finest_zoom);
  geo::TileKey last = geo::TileLattice::keyAt(extent.max, extent.finest_zoom);
  // A border that is exactly a cell's belongs to the cell before it.
  const Eigen::Vector2d last_corner = geo::TileLattice::planeOf(last);
  if (last.x > first.x && last_corner.x() == extent.max.x()) --last.x;
  if (last.y > first.y && last_corner.y() == extent.max.y()) --last.y;
  int shift = 0;  // l' of the layout (3.3): two by two cells cover the area
  while ((last.x >> shift) - (first.x >> shift) > 1 || (last.y >> shift) - (first.y >> shift) > 1) ++shift;
  // A single column or row is joined by the one that shares its parent.
  const auto pair = [shift](std::int64_t a, std::int64_t b) {
    const std::int64_t begin = a >> shift;
    return begin == (b >> shift) ? (begin & ~std::int64_t{1}) : begin;
  };
  domain.levels_ = shift + 2;
  domain.corner_ = {extent.finest_zoom, pair(first.x, last.x) << shift, pair(first.y, last.y) << shift};
  domain.last_level_ = domain.levels_ - 1 + std::countr_zero(static_cast<unsigned>(extent.tile_size));
  if (domain.last_level_ > 29 || domain.levels_ > 24)
    return fail(ErrorCode::BadInput, "the map is too large for one preview: more than 2^29 texels across");
  domain.min_texel_ = domain.texelFromPlane(extent.min);
  domain.max_texel_ = domain.texelFromPlane(extent.max);
  const geo::Geodetic middle = extent.lattice.geodeticFromPlane((extent.min + extent.max) / 2);
  domain.texel_size_m_ =
      extent.lattice.texelSize(extent.finest_zoom, middle.lat, middle.lon, extent.tile_size);
  return domain;
}

geo::TileKey Domain::key(int level, int x, int y) const {
  return {corner_.zoom - level, (corner_.x >> level) + x, (corner_.y >> level) + y};
}

Domain::Place Domain::place(const geo::TileKey& key) const {
  const int level = corner_.zoom - key.zoom;
  if (level < 0 || level > levels_ - 2) return {-1, 0, 0};
  const std::int64_t x = key.x - (corner_.x >> level), y = key.y - (corner_.y >> level);
  if (x < 0 || y < 0 || x >= tilesAcross(level) || y >= tilesAcross(level)) return {-1, 0, 0};
  return {level, static_cast<int>(x), static_cast<int>(y)};
}

Eigen::Vector2d Domain::texelFromPlane(const Eigen::Vector2d& plane) const {
  const double tiles = std::ldexp(1.0, corner_.zoom);
  return {(plane.x() * tiles - static_cast<double>(corner_.x)) * tile_size_,
          (plane.y() * tiles - static_cast<double>(corner_.y)) * tile_size_};
}

Eigen::Vector2d Domain::planeFromTexel(const Eigen::Vector2d& texel) const {
  const double cell = std::ldexp(1.0, -corner_.zoom);
  return {(texel.x() / tile_size_ + static_cast<double>(corner_.x)) * cell,
          (texel.y() / tile_size_ + static_cast<double>(corner_.y)) * cell};
}

}  // namespace overfly::preview
