#pragma once
#include <map>

#include "tiling/tile.h"

namespace overfly::tiling {

// Height steps between neighbouring texels, east-west and north-south, that are measured on both sides.
struct BorderSteps {
  double across_borders_m = 0;           // median of the absolute steps between texels of two tiles
  double inside_m = 0;                   // of those within a tile
  std::size_t borders = 0, insides = 0;  // how many
  // 1 where a border cannot be told from any other line; NaN without either.
  [[nodiscard]] double ratio() const { return across_borders_m / inside_m; }
};

// Of all tiles of one zoom. With `lattice_lines` > 1 only every so many-th border counts: those of the cells
// that were swept apart, where a cell is that many tiles wide.
[[nodiscard]] BorderSteps borderSteps(const std::map<geo::TileKey, Tile>& tiles, int lattice_lines = 1);

}  // namespace overfly::tiling
