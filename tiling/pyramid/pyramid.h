#pragma once
#include <cstddef>

#include "config/error.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling {

// Makes all coarser levels of a map from its stored level 0, up to the one where 2x2 tiles cover it (L-2),
// and commits them; returns how many tiles. Of `picture`: Color stands for all that the orthophoto comes with
// (heights, quality), another picture layer for itself alone. The store's errors; Corrupt: a damaged tile.
// Thread rule: the store's.
[[nodiscard]] Result<std::size_t> makePyramid(MapStore& store, Layer picture = Layer::Color);

}  // namespace overfly::tiling
