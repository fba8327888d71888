#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "tiling/sweep/sweep.h"

namespace overfly::tiling {

// Heights over a cell and `margin` texels around it, put together from the swept fields of the cell and its
// neighbours.
struct HeightMosaic {
  int texels = 0, margin = 0;
  int halvings = 0;           // as of the finest field
  std::vector<float> height;  // NaN: no data
  std::vector<std::uint8_t> confidence;
  std::vector<std::uint8_t> filled;  // 1: interpolated, not measured
  [[nodiscard]] int side() const { return texels + 2 * margin; }
};

// `fields`: 3x3, row by row from north-west, null where a neighbour has none; swept on like grids, but to
// levels of their own: the mosaic has the resolution of the finest, coarser ones are interpolated. `margin`
// counts texels of the grid, before any halving. Where fields overlap (within half an apron of the grid of a
// border) they change over gradually, as far as their heights agree within `step_m`; where they do not, the
// more certain one stands: a step stays a step. Every cell sees the same value at the same place, so that no
// seam shows.
[[nodiscard]] HeightMosaic assembleHeights(const std::array<const HeightField*, 9>& fields, int margin,
                                           double step_m);

}  // namespace overfly::tiling
