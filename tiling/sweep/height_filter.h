#pragma once
#include <cstdint>
#include <span>
#include <vector>

namespace overfly::tiling {

// Filters over square height fields, `side` x `side` values, row by row. Reentrant, deterministic.

// Median over (2 radius + 1)^2, radius 1 or 2; borders replicate. All values finite.
[[nodiscard]] std::vector<float> medianHeights(std::span<const float> height, int side, int radius);

// Mean over the 5x5 neighbours weighted by their score squared and by how near their height is: a neighbour
// that differs by `edge_m` counts half, by three times that next to nothing. Steps stay steps (thesis 5.5.2's
// blur made ramps of them).
[[nodiscard]] std::vector<float> smoothHeights(std::span<const float> height, std::span<const float> score,
                                               int side, double edge_m);

// The next finer grid's start: bilinear, twice the resolution. `side` = texels + 2 * apron of the coarse
// field; the fine one has 2 * texels and the same apron in its own, half as large texels.
[[nodiscard]] std::vector<float> upsampleHeights(std::span<const float> height, int texels, int apron);
// The same for the lowest and the highest of the 3x3 coarse neighbours (nearest).
struct HeightBounds {
  std::vector<float> low, high;
};
[[nodiscard]] HeightBounds upsampleBounds(std::span<const float> height, int texels, int apron);

// The highest in every block of kCeilingBlock squared heights and half a block around it: ceil(side / block)
// squared values. hidden.glsl leaves out stretches of a ray that pass above them.
inline constexpr int kCeilingBlock = 8;
[[nodiscard]] std::vector<float> ceilingOf(std::span<const float> height, int side);

// The highest within `radius` texels along both axes, of each. All values finite.
[[nodiscard]] std::vector<float> highestAround(std::span<const float> height, int side, int radius);

// Sets to NaN every 4-connected island of fewer than `min_texels` texels whose heights connect within
// `max_step_m` from texel to texel (spikes and dents, 5.5.1).
void removeIslands(std::span<float> height, int side, double max_step_m, int min_texels);

// Sets to NaN what stands like a needle, far higher than it is wide: where false matches of hidden or
// repeating ground end, and with them true poles and masts. Kept at a height is what a square of measured
// texels fits into somewhere, and what connects to it at that height (opening by reconstruction, L. Vincent
// 1993), for squares of several widths: nothing narrower than w stands more than 5 w, and 60 texels, above
// what is around it. `closed`: the same field with its small holes filled, so that a roof with holes is a
// roof; `texel_m`: of the field.
void removeNeedles(std::span<float> height, std::span<const float> closed, int side, double texel_m);

// Fills holes (NaN) of at most `max_texels` texels from the heights around them: inverse-distance mean along
// eight directions, leaving out those that stand more than `step_m` above the lowest (a hole beside a wall is
// ground in the shade of the wall, not a ramp). Marks filled texels in `filled` (1). Holes that touch the
// border of the field stay.
void fillHoles(std::span<float> height, std::span<std::uint8_t> filled, int side, int max_texels,
               double step_m);

}  // namespace overfly::tiling
