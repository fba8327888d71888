#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "config/error.h"

namespace overfly::tiling {

// The quality layer: planes of one byte per texel, each compressed by itself. Reentrant.
[[nodiscard]] Result<std::vector<std::uint8_t>> encodePlanes(
    std::span<const std::span<const std::uint8_t>> planes, int size, int zstd_level = 1);
// Corrupt unless the bytes hold planes of that size.
[[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> decodePlanes(std::span<const std::uint8_t> bytes,
                                                                          int size);

}  // namespace overfly::tiling
