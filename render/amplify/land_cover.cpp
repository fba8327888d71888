#include "render/amplify/land_cover.h"

#include <cmath>

namespace overfly::amplify {

LandCover::LandCover(double west, double south, int width, int height, const std::vector<Species>& classes)
    : west_(west), south_(south), width_(width), height_(height) {
  const auto at = [&](int x, int y) {
    return static_cast<std::uint8_t>(
        classes[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)]);
  };
  const auto cells = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  levels_[0].reserve(4 * cells);
  levels_[1].reserve(cells);
  levels_[2].reserve(cells / 4);
  for (int y = 0; y < 2 * height; ++y) {
    for (int x = 0; x < 2 * width; ++x) levels_[0].push_back(at(x / 2, y / 2));
  }
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) levels_[1].push_back(at(x, y));
  }
  for (int y = 0; y < height; y += 2) {
    for (int x = 0; x < width; x += 2) {
      levels_[2].push_back(static_cast<std::uint8_t>(at(x, y) | at(x + 1, y) << 2 | at(x, y + 1) << 4 |
                                                     at(x + 1, y + 1) << 6));
    }
  }
}

Species LandCover::at(double east, double north, int level) const {
  const double x = east - west_;
  const double y = north - south_;
  if (!(x >= 0 && y >= 0 && x < width_ && y < height_)) return Species::None;
  const double per_metre = level == 0 ? 2.0 : level == 1 ? 1.0 : 0.5;
  const auto column = static_cast<std::size_t>(x * per_metre);
  const auto row = static_cast<std::size_t>(y * per_metre);
  const std::uint8_t texel =
      levels_[static_cast<std::size_t>(level)][row * static_cast<std::size_t>(this->width(level)) + column];
  if (level < 2) return static_cast<Species>(texel);
  const int shift = (static_cast<int>(x) & 1) * 2 + (static_cast<int>(y) & 1) * 4;
  return static_cast<Species>((texel >> shift) & 3);
}

}  // namespace overfly::amplify
