#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "config/error.h"

namespace overfly::tiling::detail {

// Appends one zstd frame to `out`.
[[nodiscard]] Result<void> compress(std::span<const std::uint8_t> plain, int level,
                                    std::vector<std::uint8_t>& out);
// The whole of `packed` is one frame; Corrupt unless it holds between 0 and `most` bytes.
[[nodiscard]] Result<std::vector<std::uint8_t>> decompress(std::span<const std::uint8_t> packed,
                                                           std::size_t most);

}  // namespace overfly::tiling::detail
