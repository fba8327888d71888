#pragma once
#include <vector>

#include "tiling/tile.h"

namespace overfly::tiling {

inline constexpr int kBenchSize = 256;

// Elevation rasters of 256 x 256 cut from the recorded flights' surface models (OpenMVS), at least a third
// of each with data; from a made-up village where no flight is at hand.
[[nodiscard]] const std::vector<std::vector<float>>& elevationSamples();
[[nodiscard]] bool samplesAreReal();

// A whole tile over sample `i`: colours with the texture of the heights, measured everywhere.
[[nodiscard]] Tile tileOver(std::size_t i);

}  // namespace overfly::tiling
