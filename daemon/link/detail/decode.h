#pragma once
#include "config/error.h"
#include "daemon/link/detail/raster.h"
#include "tiling/store/map_store.h"
#include "tiling/tile.h"

// From one stored layer to a raster of `size` x `size` texels. Corrupt when the bytes do not decode.
namespace overfly::link {

[[nodiscard]] Result<Rgba> decodeColorLayer(const tiling::StoredLayer& layer, int size);
[[nodiscard]] Result<Heights> decodeHeightsLayer(const tiling::StoredLayer& layer, int size);
// Confidence, views and kind alone are filled in.
[[nodiscard]] Result<tiling::Tile> decodeQualityLayer(const tiling::StoredLayer& layer, int size);

// Confidence from red over yellow to green; transparent without data.
[[nodiscard]] Rgba qualityColours(const tiling::Tile& tile);

}  // namespace overfly::link
