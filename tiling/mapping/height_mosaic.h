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
  std::vector<float> height;  // NaN: no data
  std::vector<std::uint8_t> confidence;
  std::vector<std::uint8_t> filled;  // 1: interpolated, not measured
  [[nodiscard]] int side() const { return texels + 2 * margin; }
};

// `fields`: 3x3, row by row from north-west, null where a neighbour has none; all of one size and apron.
// Where fields overlap (within half an apron of a border) they change over gradually, as far as their heights
// agree within `step_m`; where they do not, the more certain one stands: a step stays a step. Every cell sees
// the same value at the same place, so that no seam shows.
[[nodiscard]] HeightMosaic assembleHeights(const std::array<const HeightField*, 9>& fields, int margin,
                                           double step_m);

}  // namespace overfly::tiling
