#include "render/preview/height_grid.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace overfly::preview {

HeightGrid::HeightGrid(int width, int height)
    : width_(width),
      height_(height),
      heights_(static_cast<std::size_t>(width + 2) * static_cast<std::size_t>(height + 2),
               std::numeric_limits<float>::quiet_NaN()),
      valid_(heights_.size(), 0) {}

Result<HeightGrid> HeightGrid::load(const Domain& domain, TileSource& source, int level) {
  const int across = domain.texelsAcross(level), size = domain.tileSize();
  if (across > 1 << 13 || level > domain.levels() - 2)
    return fail(ErrorCode::BadInput, "the map is too large to be loaded as one grid of heights");
  HeightGrid grid(across, across);
  for (int ty = 0; ty < domain.tilesAcross(level); ++ty) {
    for (int tx = 0; tx < domain.tilesAcross(level); ++tx) {
      const auto tile = source.load(domain.key(level, tx, ty));
      if (!tile) {
        if (tile.error().code == ErrorCode::NotFound) continue;
        return tl::unexpected(tile.error());
      }
      if ((*tile)->elevation.empty()) continue;
      const float* from = (*tile)->elevation.data();
      for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x) grid.set(tx * size + x, ty * size + y, *from++);
    }
  }
  grid.fill();
  return grid;
}

void HeightGrid::fill() {
  for (int y = -1; y <= height_; ++y)
    for (int x = -1; x <= width_; ++x) valid_[index(x, y)] = std::isfinite(at(x, y)) ? 1 : 0;
  for (int y = -1; y <= height_; ++y) {
    for (int x = -1; x <= width_; ++x) {
      if (valid_[index(x, y)] != 0) continue;
      double sum = 0;
      int count = 0;
      for (int j = std::max(y - 1, -1); j <= std::min(y + 1, height_); ++j)
        for (int i = std::max(x - 1, -1); i <= std::min(x + 1, width_); ++i)
          if (valid_[index(i, j)] != 0) {
            sum += static_cast<double>(at(i, j));
            ++count;
          }
      if (count > 0) heights_[index(x, y)] = static_cast<float>(sum / count);
    }
  }
}

Neighbourhood HeightGrid::around(int x, int y) const {
  Neighbourhood h;
  for (int j = -1; j <= 1; ++j)
    for (int i = -1; i <= 1; ++i)
      h[static_cast<std::size_t>(3 * (j + 1) + i + 1)] = static_cast<double>(at(x + i, y + j));
  return h;
}

}  // namespace overfly::preview
