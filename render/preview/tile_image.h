#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "render/preview/tile_source.h"

namespace overfly::preview {

// Height of what has no data, on the GPU: GLSL ES promises nothing about NaN.
inline constexpr float kNoHeight = -1e30F;

// What rays do where the map has no data.
enum class NoData {
  Hole,   // pass
  Patch,  // hit a surface spread between the edges, which is drawn hatched
};

// A tile as it lies in GPU memory. Heights count from the map's base height, so that float keeps a tenth of a
// millimetre. Layers with a rim have one texel more on each side, from the neighbours: sampling between texel
// centres then needs no second tile.
struct TileImage {
  int size = 0;                       // texels across, without the rim
  std::vector<float> heights;         // with rim; texels without data beside such with data are filled
  std::vector<float> bounds;          // no surface over the texel, of this or a finer level, is higher
  std::vector<std::uint8_t> color;    // with rim; RGBA8, premultiplied: alpha 0 weighs nothing when averaged
  std::vector<std::uint8_t> quality;  // two bytes: confidence, and 255 where there is data
  float lowest = -kNoHeight;          // of the heights; above the highest where there are none
  float highest = kNoHeight;          // of the bounds
};

// A tile and its eight neighbours of the same level, row by row from the north-west; null: not there. [4] is
// the tile itself.
using TileBlock = std::array<SourceTilePtr, 9>;

// Reentrant. A tile without elevation gets no heights at all.
[[nodiscard]] TileImage makeTileImage(const TileBlock& block, double base_height_m, NoData no_data);

// Level L-1, the tile that covers the domain, and its mip levels down to one texel, from the two by two tiles
// of level L-2 (row by row; null: not there). levels[i] has size >> i texels across; colour and heights are
// means, bounds maxima. Beyond the domain is no data.
struct TopImage {
  std::vector<TileImage> levels;
  double lowest_m = 0, highest_m = 0;  // of the bounds and heights, absolute
};
// The height that a map's heights count from: a whole metre in the middle of the top's; none: no heights yet.
[[nodiscard]] std::optional<double> baseHeightOf(const std::array<SourceTilePtr, 4>& children);
[[nodiscard]] TopImage makeTopImage(const std::array<SourceTilePtr, 4>& children, int size,
                                    double base_height_m);

}  // namespace overfly::preview
