#pragma once
#include <filesystem>
#include <map>
#include <vector>

#include "capture/geo/tile_lattice.h"
#include "config/error.h"
#include "daemon/tradeoff/trial.h"
#include "render/gl/context.h"
#include "tiling/mapping/mapper.h"

namespace overfly::tradeoff {

// Draws an oblique view of a finished map (its level-0 tiles; the coarser levels are made from them) with
// every surface, filter and resolution of the preview, tiles in GPU memory already. The error is the mean
// difference of red, green and blue, 0 to 255, from a picture of twice the resolution with the bicubic
// surface, 16 anisotropic samples and the finest level everywhere, averaged down. Time is per picture of
// `width` columns (16:9), drawn and read back. `scratch`: a map file that is not there
// yet. BadInput: nothing to draw.
[[nodiscard]] Result<std::vector<Trial>> tryPreview(gl::Context& context,
                                                    const std::map<geo::TileKey, tiling::Tile>& tiles,
                                                    const tiling::MapGround& ground, int tile_size,
                                                    const std::filesystem::path& scratch, int width,
                                                    int repeats);

}  // namespace overfly::tradeoff
