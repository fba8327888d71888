#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "config/error.h"
#include "tiling/store/layer.h"

namespace overfly::tiling {

enum class ColorFormat {
  Auto,  // JPEG for a tile without a hole, WebP for one with: both can be served as they are
  Webp,  // always
};

struct ColorCoding {
  ColorFormat format = ColorFormat::Auto;
  int quality = 85;     // 1..100 of the JPEG or WebP encoder
  int webp_method = 1;  // 0 (fast) .. 6 (small)
};

struct CodedColor {
  Codec codec = Codec::Webp;
  std::vector<std::uint8_t> bytes;
};

// `rgba` has 4 * size * size bytes. Alpha survives exactly; where it is 0, r = g = b = 0 after decoding.
// Reentrant.
[[nodiscard]] Result<CodedColor> encodeColor(std::span<const std::uint8_t> rgba, int size,
                                             const ColorCoding& coding);
// Corrupt when the bytes do not decode to a picture of that size.
[[nodiscard]] Result<std::vector<std::uint8_t>> decodeColor(Codec codec, std::span<const std::uint8_t> bytes,
                                                            int size);

}  // namespace overfly::tiling
