#pragma once
#include <map>
#include <vector>

#include "capture/geo/tile_lattice.h"
#include "config/error.h"
#include "daemon/tradeoff/trial.h"
#include "tiling/tile.h"

namespace overfly::tradeoff {

// Codes and decodes the tiles' colour (JPEG and WebP at several qualities) and heights (several steps):
// bytes and time against the error of what comes back. Two parts, "colour" and "heights"; time is per tile,
// coding and decoding. The tiles must be complete enough to be coded; at least one.
[[nodiscard]] Result<std::vector<Trial>> tryCodecs(const std::map<geo::TileKey, tiling::Tile>& tiles,
                                                   int repeats);

// Peak signal-to-noise ratio of two RGBA pictures where both are opaque, dB (infinite when equal).
[[nodiscard]] double psnr(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b);
// Structural similarity of their luminance (Wang et al. 2004, 8x8 windows every 4 texels, constants of the
// paper), mean over windows that are opaque in both; 1 when equal or no window is.
[[nodiscard]] double ssim(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b, int size);

}  // namespace overfly::tradeoff
