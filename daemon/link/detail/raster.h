#pragma once
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace overfly::link {

inline constexpr int kLinkTile = 256;  // texels along a side of every tile on the link
inline constexpr float kNoHeight = std::numeric_limits<float>::quiet_NaN();

// Row 0 in the north, tightly packed.
struct Rgba {
  int width = 0, height = 0;
  std::vector<std::uint8_t> texels;  // 4 bytes each, not premultiplied; alpha 0: no data
  Rgba() = default;
  Rgba(int w, int h)
      : width(w), height(h), texels(static_cast<std::size_t>(w) * static_cast<std::size_t>(h) * 4) {}
  [[nodiscard]] std::uint8_t* at(int x, int y) {
    return texels.data() +
           (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)) * 4;
  }
  [[nodiscard]] const std::uint8_t* at(int x, int y) const { return const_cast<Rgba*>(this)->at(x, y); }
};

struct Heights {
  int width = 0, height = 0;
  std::vector<float> texels;  // metres, NaN: no data
  Heights() = default;
  Heights(int w, int h)
      : width(w), height(h), texels(static_cast<std::size_t>(w) * static_cast<std::size_t>(h), kNoHeight) {}
  [[nodiscard]] float& at(int x, int y) {
    return texels[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                  static_cast<std::size_t>(x)];
  }
  [[nodiscard]] float at(int x, int y) const { return const_cast<Heights*>(this)->at(x, y); }
};

}  // namespace overfly::link
