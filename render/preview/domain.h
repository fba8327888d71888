#pragma once
#include <Eigen/Core>
#include <cstdint>

#include "capture/geo/tile_lattice.h"
#include "config/error.h"
#include "render/preview/tile_source.h"

namespace overfly::preview {

// The square that the preview casts rays into: 2^(L-1) by 2^(L-1) of the map's finest tiles, so that the one
// tile at level L-1 (the top) covers it and level L-2 has two by two tiles (thesis, 3.2.4). Level l lies at
// zoom `finest - l`; levels from L on are the top tile's mip levels, down to one texel at lastLevel().
//
// Everything is counted from the square's north-west corner in whole texels, so that a position is exact at
// any distance from the lattice's origin, and fits 32 bits. Value type, reentrant.
class Domain {
 public:
  // BadInput: no area, or a map of more than 2^29 texels across.
  [[nodiscard]] static Result<Domain> create(const MapExtent& extent);

  [[nodiscard]] int levels() const { return levels_; }         // L, at least 2
  [[nodiscard]] int lastLevel() const { return last_level_; }  // one texel
  [[nodiscard]] int tileSize() const { return tile_size_; }
  [[nodiscard]] int tilesAcross(int level) const {
    return level >= levels_ - 1 ? 1 : 1 << (levels_ - 1 - level);
  }
  [[nodiscard]] int texelsAcross(int level) const { return 1 << (last_level_ - level); }
  [[nodiscard]] const geo::TileLattice& lattice() const { return lattice_; }

  // Tile (x, y) of level 0 .. L-2, counted from the corner.
  [[nodiscard]] geo::TileKey key(int level, int x, int y) const;
  struct Place {
    int level = 0, x = 0, y = 0;
  };
  // Where a tile of the lattice lies; level -1: not in this square (or not of its levels).
  [[nodiscard]] Place place(const geo::TileKey& key) const;

  // Plane coordinates <-> level-0 texels from the corner.
  [[nodiscard]] Eigen::Vector2d texelFromPlane(const Eigen::Vector2d& plane) const;
  [[nodiscard]] Eigen::Vector2d planeFromTexel(const Eigen::Vector2d& texel) const;
  // Side of a level-0 texel at the middle of the map, metres.
  [[nodiscard]] double texelSize() const { return texel_size_m_; }
  // Of the map's tiles, in level-0 texels.
  [[nodiscard]] const Eigen::Vector2d& minTexel() const { return min_texel_; }
  [[nodiscard]] const Eigen::Vector2d& maxTexel() const { return max_texel_; }

  friend bool operator==(const Domain& a, const Domain& b) {
    return a.lattice_ == b.lattice_ && a.corner_ == b.corner_ && a.levels_ == b.levels_ &&
           a.tile_size_ == b.tile_size_;
  }

 private:
  geo::TileLattice lattice_ = geo::TileLattice::webMercator();
  geo::TileKey corner_;  // the north-west tile at level 0
  int levels_ = 2, last_level_ = 0, tile_size_ = 256;
  double texel_size_m_ = 1;
  Eigen::Vector2d min_texel_{0, 0}, max_texel_{0, 0};
};

}  // namespace overfly::preview
