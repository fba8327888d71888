#pragma once
#include "daemon/link/detail/map_view.h"
#include "daemon/link/detail/raster.h"

// Pixels of a link tile from pixels of stored tiles. Pure functions.
namespace overfly::link {

// Copies, averages (colour by alpha, heights over what is valid) or interpolates a piece into `to`.
void place(const Rgba& from, const Piece& piece, Rgba& to);
void place(const Heights& from, const Piece& piece, Heights& to);

// At (x, y) in texels, the first texel's centre at (0.5, 0.5); over the valid ones of the four nearest, NaN
// when the nearest one has no data.
[[nodiscard]] float bilinear(const Heights& heights, double x, double y);

// Slopes by Horn's formula over a bordered grid (258 x 258), lit from the north-west at 45 degrees; black
// with the shade's strength as alpha, so that it lies over colour. `texel_m`: ground distance of two texels.
[[nodiscard]] Rgba hillshade(const Heights& bordered, double texel_m);

}  // namespace overfly::link
