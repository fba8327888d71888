#pragma once
#include <array>

#include "tiling/tile.h"

namespace overfly::tiling {

// A tile of the next coarser level from its four children (nullptr: none stored), child i as in childOf():
// bit 0 east, bit 1 south. Also makes the top tile. Always from whole children, never by patching a quadrant
// into an earlier parent, which would code a lossy tile twice. Each texel is made of the 2x2 texels beneath
// it:
//   colour      mean of those with data (alpha > 0), each channel rounded to nearest
//   elevation   mean of those with data, in double, then float
//   elevation_max  maximum of the children's bounds and of the parent's own: no finer tile rises above it
//   confidence, views, gsd code   rounded mean of those with data;  kind   union of their bits
// source and frame_set stay empty: a coarse tile would name half the flight. A layer exists where some child
// has it. Deterministic: the result is a function of the children's bits.
// All children are of one size, which is even.
[[nodiscard]] Tile makeParent(const geo::TileKey& key, const std::array<const Tile*, 4>& children);

// makeParent() in two steps for tiles without heights, so that a child can be kept as what its parent needs
// of it, a quarter of its bytes: joinHalves of the halved children is makeParent of the children, bit for
// bit. `halves`: nullptr where there is no child; all of one size. `reuse`: memory for the result, of a tile
// that is no longer needed, whatever it holds.
[[nodiscard]] Tile halved(const Tile& child, Tile&& reuse = {});
[[nodiscard]] Tile joinHalves(const geo::TileKey& key, const std::array<const Tile*, 4>& halves,
                              Tile&& reuse = {});

}  // namespace overfly::tiling
