#pragma once
#include <cstdint>
#include <span>
#include <vector>

namespace overfly::tiling {

// Heights everywhere: where there are none (NaN), the surroundings' mean at the finest scale that has any
// (push-pull over a pyramid), without what stands more than a step above the lowest there: a hole beside a wall
// is ground in its shade, not a ramp. `step_m` at the finest scale, twice as much at each coarser one;
// `fallback_m` when the whole field is empty. For projecting colour only, never stored as elevation.
// side x side values.
[[nodiscard]] std::vector<float> guessSurface(std::span<const float> height, int side, double step_m,
                                              double fallback_m);

}  // namespace overfly::tiling
