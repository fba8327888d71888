#pragma once
#include <cstdint>
#include <vector>

#include "config/error.h"
#include "render/preview/domain.h"
#include "render/preview/surface.h"
#include "render/preview/tile_source.h"

namespace overfly::preview {

// A rectangle of heights of one level, with a rim. A texel without data that touches one with data takes the
// mean of its neighbours (of eight) that have some: so the surface is defined over every texel with data, and
// continuous. Such a filled texel is not valid: rays pass it.
class HeightGrid {
 public:
  // `width` x `height` texels, all without data.
  HeightGrid(int width, int height);
  // All of a level of the map, for maps of at most 2^26 texels: BadInput beyond.
  [[nodiscard]] static Result<HeightGrid> load(const Domain& domain, TileSource& source, int level);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] bool inside(int x, int y) const { return x >= 0 && y >= 0 && x < width_ && y < height_; }
  [[nodiscard]] bool valid(int x, int y) const { return inside(x, y) && valid_[index(x, y)] != 0; }
  // Of a texel or its rim; NaN where neither is.
  [[nodiscard]] float at(int x, int y) const { return heights_[index(x, y)]; }  // x, y from -1 to the size
  void set(int x, int y, float height_m) { heights_[index(x, y)] = height_m; }  // call fill() afterwards
  void fill();
  [[nodiscard]] Neighbourhood around(int x, int y) const;  // of a valid texel

 private:
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y + 1) * static_cast<std::size_t>(width_ + 2) +
           static_cast<std::size_t>(x + 1);
  }
  int width_, height_;
  std::vector<float> heights_;       // with a rim of one texel
  std::vector<std::uint8_t> valid_;  // likewise
};

}  // namespace overfly::preview
