#pragma once
#include "config/error.h"
#include "render/gl/context.h"

namespace overfly::gl {

// Mantissa bits of highp float as the GPU really computes, not as it says: 23 is IEEE single. The sweep's
// projections need at least 20 (a tenth of a pixel in an image of 8,192).
struct Precision {
  int fragment_bits = 0;
  int compute_bits = 0;
};
inline constexpr int kNeededMantissaBits = 20;

[[nodiscard]] Result<Precision> probePrecision(Context& context);

}  // namespace overfly::gl
