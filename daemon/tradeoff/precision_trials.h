#pragma once
#include <vector>

#include "config/error.h"
#include "daemon/tradeoff/trial.h"
#include "render/gl/context.h"

namespace overfly::tradeoff {

// What float32 costs: every texel of a tile is projected into a camera 100 m above it, with double on the CPU
// (exactly, and by the tile frame's polynomial) and with float32 on the GPU in the tile's own frame, in a
// local frame whose origin lies 1, 30 and 1,000 km away, and in ECEF. The error is the largest difference
// from the exact place, pixels; time is for a million texels.
[[nodiscard]] Result<std::vector<Trial>> tryPrecision(gl::Context& context, int repeats);

}  // namespace overfly::tradeoff
