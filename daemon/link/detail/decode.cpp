#include "daemon/link/detail/decode.h"

#include <algorithm>

#include "tiling/store/tile_codec.h"

namespace overfly::link {

Result<Rgba> decodeColorLayer(const tiling::StoredLayer& layer, int size) {
  auto tile = tiling::decodeTile({}, {&layer, 1}, size);
  if (!tile) return tl::unexpected(tile.error());
  Rgba out;
  out.width = out.height = size;
  out.texels = std::move(tile->color);
  return out;
}

Result<Heights> decodeHeightsLayer(const tiling::StoredLayer& layer, int size) {
  auto tile = tiling::decodeTile({}, {&layer, 1}, size);
  if (!tile) return tl::unexpected(tile.error());
  Heights out;
  out.width = out.height = size;
  out.texels = std::move(tile->elevation);
  return out;
}

Result<tiling::Tile> decodeQualityLayer(const tiling::StoredLayer& layer, int size) {
  return tiling::decodeTile({}, {&layer, 1}, size);
}

Rgba qualityColours(const tiling::Tile& tile) {
  constexpr float kRamp[3][3] = {{214, 69, 65}, {244, 208, 63}, {63, 176, 105}};
  Rgba out(tile.size, tile.size);
  for (std::size_t i = 0; i < tile.texels(); ++i) {
    if (tile.kind.empty() || tile.kind[i] == tiling::kNoData) continue;
    const float at = static_cast<float>(tile.confidence[i]) / 255.0F * 2;
    const auto low = static_cast<std::size_t>(std::min(at, 1.0F));
    const float part = at - static_cast<float>(low);
    auto* texel = out.texels.data() + 4 * i;
    for (std::size_t c = 0; c < 3; ++c)
      texel[c] = static_cast<std::uint8_t>(kRamp[low][c] + part * (kRamp[low + 1][c] - kRamp[low][c]) + 0.5F);
    texel[3] = 255;
  }
  return out;
}

}  // namespace overfly::link
