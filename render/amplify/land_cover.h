#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "render/amplify/plant.h"

namespace overfly::amplify {

// Which species the ground carries, as a quadtree of three levels with the packing of Amara et al. (4.1,
// figure 1): level 1 holds one class per texel of 1 m on 8 bits; level 0 (0.5 m) repeats each class on four
// neighbours; level 2 (2 m) packs four level-1 neighbours into one byte, two bits each. All three answer the
// same for the same place, so nothing pops when the level changes. Value type, reentrant.
class LandCover {
 public:
  static constexpr int kLevels = 3;

  LandCover() = default;
  // classes: width x height level-1 texels, row 0 in the south, texel (0, 0)'s corner at (west, south);
  // width and height even.
  LandCover(double west, double south, int width, int height, const std::vector<Species>& classes);

  [[nodiscard]] int width(int level) const {
    return level == 0 ? 2 * width_ : level == 1 ? width_ : width_ / 2;
  }
  [[nodiscard]] int height(int level) const {
    return level == 0 ? 2 * height_ : level == 1 ? height_ : height_ / 2;
  }
  [[nodiscard]] double west() const { return west_; }
  [[nodiscard]] double south() const { return south_; }
  [[nodiscard]] const std::vector<std::uint8_t>& texels(int level) const {
    return levels_[static_cast<std::size_t>(level)];
  }

  // Class at a place, read from the given level; None outside.
  [[nodiscard]] Species at(double east, double north, int level = 1) const;

 private:
  double west_ = 0, south_ = 0;
  int width_ = 0, height_ = 0;
  std::array<std::vector<std::uint8_t>, kLevels> levels_;
};

}  // namespace overfly::amplify
