#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "tiling/store/codec_color.h"
#include "tiling/store/codec_heights.h"
#include "tiling/store/codec_planes.h"
#include "tiling/store/tile_codec.h"

// Any bytes as one coded layer of a tile: decoded to the size that was asked for, or refused.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace overfly::tiling;
  if (size < 2) return 0;
  constexpr int kSide = 32;
  const auto texels = static_cast<std::size_t>(kSide) * kSide;
  const std::span<const std::uint8_t> bytes(data + 1, size - 1);
  switch (data[0] % 6) {
    case 0:
      if (const auto heights = decodeHeights(bytes, kSide); heights && heights->size() != texels)
        std::abort();
      break;
    case 1:
      if (const auto bound = decodeBound(bytes, kSide); bound && bound->size() != texels) std::abort();
      break;
    case 2:
      if (const auto heights = decodeExactHeights(bytes, kSide); heights && heights->size() != texels)
        std::abort();
      break;
    case 3:
      if (const auto color = decodeColor(Codec::Jpeg, bytes, kSide); color && color->size() != 4 * texels)
        std::abort();
      break;
    case 4:
      if (const auto color = decodeColor(Codec::Webp, bytes, kSide); color && color->size() != 4 * texels)
        std::abort();
      break;
    default: {
      StoredLayer layer;
      layer.encoded.layer = Layer::Quality;
      layer.encoded.codec = Codec::Planes;
      layer.encoded.bytes.assign(bytes.begin(), bytes.end());
      const auto tile = decodeTile({}, std::span(&layer, 1), kSide);
      if (tile && !tile->kind.empty() && tile->kind.size() != texels) std::abort();
    }
  }
  return 0;
}
