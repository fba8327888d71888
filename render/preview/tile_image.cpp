#include "render/preview/tile_image.h"

#include <algorithm>
#include <cmath>

#include "render/preview/height_grid.h"

namespace overfly::preview {
namespace {

std::size_t at(int x, int y, int stride) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(stride) + static_cast<std::size_t>(x);
}

// The tile of the block that texel (x, y) of the middle one's coordinates lies in, and the texel's index
// there.
struct Source {
  const SourceTile* tile = nullptr;
  std::size_t texel = 0;
};
Source sourceOf(const TileBlock& block, int x, int y, int size) {
  const int column = x < 0 ? 0 : x < size ? 1 : 2, row = y < 0 ? 0 : y < size ? 1 : 2;
  const SourceTile* tile = block[static_cast<std::size_t>(3 * row + column)].get();
  return {tile, at(x - (column - 1) * size, y - (row - 1) * size, size)};
}

// Every texel without data takes the mean of what lies around it, from ever coarser means (push, pull).
void spread(std::vector<float>& values, int size) {
  if (size == 1) return;
  const int half = size / 2;
  std::vector<float> coarse(static_cast<std::size_t>(half) * static_cast<std::size_t>(half), kNoHeight);
  for (int y = 0; y < half; ++y) {
    for (int x = 0; x < half; ++x) {
      double sum = 0;
      int count = 0;
      for (int i = 0; i < 4; ++i) {
        const float v = values[at(2 * x + (i & 1), 2 * y + (i >> 1), size)];
        if (v == kNoHeight) continue;
        sum += static_cast<double>(v);
        ++count;
      }
      if (count > 0) coarse[at(x, y, half)] = static_cast<float>(sum / count);
    }
  }
  spread(coarse, half);
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      float& v = values[at(x, y, size)];
      if (v != kNoHeight) continue;
      const int x0 = x / 2, y0 = y / 2;
      const int x1 = std::clamp(x0 + ((x & 1) != 0 ? 1 : -1), 0, half - 1);
      const int y1 = std::clamp(y0 + ((y & 1) != 0 ? 1 : -1), 0, half - 1);
      v = 0.5625F * coarse[at(x0, y0, half)] + 0.1875F * coarse[at(x1, y0, half)] +
          0.1875F * coarse[at(x0, y1, half)] + 0.0625F * coarse[at(x1, y1, half)];
    }
  }
}

void copyColor(const std::uint8_t* from, std::uint8_t* to) {
  const unsigned alpha = from[3];
  for (int c = 0; c < 3; ++c) to[c] = static_cast<std::uint8_t>((from[c] * alpha + 127) / 255);
  to[3] = from[3];
}

void fillHeights(const TileBlock& block, double base, TileImage& image) {
  const int size = image.size, rimmed = size + 2;
  // One texel more than the rim, so that the rim is filled as the neighbour fills it.
  HeightGrid grid(rimmed, rimmed);
  for (int y = -2; y < size + 2; ++y) {
    for (int x = -2; x < size + 2; ++x) {
      const Source source = sourceOf(block, x, y, size);
      if (source.tile != nullptr && !source.tile->elevation.empty())
        grid.set(x + 1, y + 1, source.tile->elevation[source.texel]);
    }
  }
  grid.fill();
  image.heights.assign(static_cast<std::size_t>(rimmed) * static_cast<std::size_t>(rimmed), kNoHeight);
  for (int y = 0; y < rimmed; ++y) {
    for (int x = 0; x < rimmed; ++x) {
      const float h = grid.at(x, y);
      if (std::isfinite(h))
        image.heights[at(x, y, rimmed)] = static_cast<float>(static_cast<double>(h) - base);
    }
  }
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x)
      if (grid.valid(x + 1, y + 1)) image.quality[2 * at(x, y, size) + 1] = 255;
}

// The texels beyond the data, hatched.
void patch(TileImage& image) {
  const int size = image.size, rimmed = size + 2;
  std::vector<float> inner(static_cast<std::size_t>(size) * static_cast<std::size_t>(size));
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x) inner[at(x, y, size)] = image.heights[at(x + 1, y + 1, rimmed)];
  if (std::all_of(inner.begin(), inner.end(), [](float h) { return h == kNoHeight; })) return;
  spread(inner, size);
  for (int y = 0; y < rimmed; ++y) {
    for (int x = 0; x < rimmed; ++x) {
      float& h = image.heights[at(x, y, rimmed)];
      if (h == kNoHeight) h = inner[at(std::clamp(x - 1, 0, size - 1), std::clamp(y - 1, 0, size - 1), size)];
    }
  }
}

void fillBounds(const TileBlock& block, double base, NoData no_data, TileImage& image) {
  const int size = image.size, rimmed = size + 2;
  const auto stored = [&](int x, int y) {
    const Source source = sourceOf(block, x, y, size);
    if (source.tile == nullptr || source.tile->elevation_max.empty()) return kNoHeight;
    const float bound = source.tile->elevation_max[source.texel];
    if (!std::isfinite(bound)) return kNoHeight;
    return std::nextafter(static_cast<float>(static_cast<double>(bound) - base), 1e30F);
  };
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      const bool valid = image.quality[2 * at(x, y, size) + 1] != 0;
      if (!valid && no_data == NoData::Hole) continue;
      float bound = valid ? stored(x, y) : kNoHeight;
      for (int j = 0; j <= 2; ++j)
        for (int i = 0; i <= 2; ++i) bound = std::max(bound, image.heights[at(x + i, y + j, rimmed)]);
      // A neighbour's finer tiles reach over the border by half a texel of theirs.
      if (x == 0 || y == 0 || x == size - 1 || y == size - 1) {
        for (int j = -1; j <= 1; ++j)
          for (int i = -1; i <= 1; ++i)
            if (x + i < 0 || y + j < 0 || x + i >= size || y + j >= size)
              bound = std::max(bound, stored(x + i, y + j));
      }
      image.bounds[at(x, y, size)] = bound;
    }
  }
}

// The heights of an image without a rim, those beside data filled, with a rim.
std::vector<float> withRim(const TileImage& image) {
  HeightGrid grid(image.size, image.size);
  for (int y = 0; y < image.size; ++y)
    for (int x = 0; x < image.size; ++x)
      if (const float h = image.heights[at(x, y, image.size)]; h != kNoHeight) grid.set(x, y, h);
  grid.fill();
  std::vector<float> out;
  for (int y = -1; y <= image.size; ++y)
    for (int x = -1; x <= image.size; ++x)
      out.push_back(std::isfinite(grid.at(x, y)) ? grid.at(x, y) : kNoHeight);
  return out;
}

}  // namespace

TileImage makeTileImage(const TileBlock& block, double base_height_m, NoData no_data) {
  const SourceTile& tile = *block[4];
  TileImage image;
  image.size = tile.size;
  const int size = tile.size, rimmed = size + 2;
  const std::size_t texels = static_cast<std::size_t>(size) * static_cast<std::size_t>(size);
  const std::size_t with_rim = static_cast<std::size_t>(rimmed) * static_cast<std::size_t>(rimmed);
  image.quality.assign(2 * texels, 0);
  image.bounds.assign(texels, kNoHeight);
  image.color.assign(4 * with_rim, 0);
  fillHeights(block, base_height_m, image);
  if (no_data == NoData::Patch) patch(image);
  fillBounds(block, base_height_m, no_data, image);
  for (std::size_t i = 0; i < tile.confidence.size(); ++i) image.quality[2 * i] = tile.confidence[i];
  for (int y = 0; y < rimmed; ++y) {
    for (int x = 0; x < rimmed; ++x) {
      const Source source = sourceOf(block, x - 1, y - 1, size);
      if (source.tile != nullptr && !source.tile->color.empty())
        copyColor(&source.tile->color[4 * source.texel], &image.color[4 * at(x, y, rimmed)]);
    }
  }
  for (const float height : image.heights)
    if (height != kNoHeight) image.lowest = std::min(image.lowest, height);
  for (const float bound : image.bounds) image.highest = std::max(image.highest, bound);
  return image;
}

std::optional<double> baseHeightOf(const std::array<SourceTilePtr, 4>& children) {
  float lowest = -kNoHeight, highest = kNoHeight;
  for (const SourceTilePtr& child : children) {
    if (child == nullptr) continue;
    for (std::size_t i = 0; i < child->elevation.size(); ++i) {
      const float h = child->elevation[i];
      if (!std::isfinite(h)) continue;
      lowest = std::min(lowest, h);
      highest = std::max(highest, h);
      if (!child->elevation_max.empty() && std::isfinite(child->elevation_max[i]))
        highest = std::max(highest, child->elevation_max[i]);
    }
  }
  if (highest < lowest) return std::nullopt;
  return std::round((static_cast<double>(lowest) + static_cast<double>(highest)) / 2);
}

TopImage makeTopImage(const std::array<SourceTilePtr, 4>& children, int size, double base_height_m) {
  TopImage top;
  const auto blank = [](int across) {
    TileImage image;
    image.size = across;
    const std::size_t n = static_cast<std::size_t>(across) * static_cast<std::size_t>(across);
    image.heights.assign(n, kNoHeight);
    image.bounds.assign(n, kNoHeight);
    image.color.assign(4 * n, 0);
    image.quality.assign(2 * n, 0);
    return image;
  };
  // Level L-2 as one image, which then is halved again and again.
  TileImage below = blank(2 * size);
  float lowest = 1e30F, highest = kNoHeight;
  for (std::size_t c = 0; c < 4; ++c) {
    if (children[c] == nullptr) continue;
    const SourceTile& tile = *children[c];
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) {
        const std::size_t from = at(x, y, size);
        const std::size_t to =
            at(x + static_cast<int>(c & 1) * size, y + static_cast<int>(c >> 1) * size, 2 * size);
        if (!tile.color.empty()) copyColor(&tile.color[4 * from], &below.color[4 * to]);
        if (tile.elevation.empty() || !std::isfinite(tile.elevation[from])) continue;
        const float h = static_cast<float>(static_cast<double>(tile.elevation[from]) - base_height_m);
        below.heights[to] = h;
        below.quality[2 * to] = tile.confidence.empty() ? std::uint8_t{0} : tile.confidence[from];
        below.quality[2 * to + 1] = 255;
        float bound = h;
        if (!tile.elevation_max.empty() && std::isfinite(tile.elevation_max[from]))
          bound = std::max(
              bound,
              std::nextafter(
                  static_cast<float>(static_cast<double>(tile.elevation_max[from]) - base_height_m), 1e30F));
        below.bounds[to] = bound;
        lowest = std::min(lowest, h);
        highest = std::max(highest, bound);
      }
    }
  }
  for (int across = size; across >= 1; across /= 2) {
    TileImage image = blank(across);
    for (int y = 0; y < across; ++y) {
      for (int x = 0; x < across; ++x) {
        const std::size_t to = at(x, y, across);
        double sum = 0;
        unsigned count = 0, color[4] = {2, 2, 2, 2}, confidence = 0;
        for (int i = 0; i < 4; ++i) {
          const std::size_t from = at(2 * x + (i & 1), 2 * y + (i >> 1), 2 * across);
          for (std::size_t c = 0; c < 4; ++c) color[c] += below.color[4 * from + c];
          if (below.quality[2 * from + 1] == 0) continue;
          sum += static_cast<double>(below.heights[from]);
          confidence += below.quality[2 * from];
          image.bounds[to] = std::max(image.bounds[to], below.bounds[from]);
          ++count;
        }
        for (std::size_t c = 0; c < 4; ++c) image.color[4 * to + c] = static_cast<std::uint8_t>(color[c] / 4);
        if (count == 0) continue;
        image.heights[to] = static_cast<float>(sum / count);
        image.quality[2 * to] = static_cast<std::uint8_t>(confidence / count);
        image.quality[2 * to + 1] = 255;
      }
    }
    // A smooth surface reaches into the neighbouring texel: the bound covers what lies around, too; and from
    // here up the maxima hold this level's.
    const std::vector<float> plain = image.bounds;
    const std::vector<float> rimmed = withRim(image);
    for (int y = 0; y < across; ++y) {
      for (int x = 0; x < across; ++x) {
        if (image.quality[2 * at(x, y, across) + 1] == 0) continue;
        float& bound = image.bounds[at(x, y, across)];
        for (int j = 0; j <= 2; ++j)
          for (int i = 0; i <= 2; ++i) bound = std::max(bound, rimmed[at(x + i, y + j, across + 2)]);
        for (int j = std::max(y - 1, 0); j <= std::min(y + 1, across - 1); ++j)
          for (int i = std::max(x - 1, 0); i <= std::min(x + 1, across - 1); ++i)
            bound = std::max(bound, plain[at(i, j, across)]);
      }
    }
    below = image;
    image.heights = rimmed;
    image.color.assign(4 * rimmed.size(), 0);
    for (int y = 0; y < across; ++y)
      std::copy_n(&below.color[4 * at(0, y, across)], 4 * across, &image.color[4 * at(1, y + 1, across + 2)]);
    top.levels.push_back(std::move(image));
  }
  top.lowest_m = static_cast<double>(lowest) + base_height_m;
  top.highest_m = static_cast<double>(highest) + base_height_m;
  return top;
}

}  // namespace overfly::preview
