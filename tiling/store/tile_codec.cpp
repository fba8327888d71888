#include "tiling/store/tile_codec.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tiling/store/codec_planes.h"

namespace overfly::tiling {
namespace {

// The quality layer's planes, in this order.
enum Plane : std::size_t { kKind, kConfidence, kViews, kSourceLow, kSourceHigh, kGsd, kAngle, kPlanes };

LayerStatistics heightStatistics(std::span<const float> heights) {
  LayerStatistics statistics;
  for (const float height : heights) {
    if (std::isnan(height)) continue;
    statistics.min = statistics.valid == 0 ? height : std::min(statistics.min, height);
    statistics.max = statistics.valid == 0 ? height : std::max(statistics.max, height);
    ++statistics.valid;
  }
  return statistics;
}

Result<void> checkTile(const Tile& tile) {
  const std::size_t n = tile.texels();
  const auto fits = [n](std::size_t size) { return size == 0 || size == n; };
  if (tile.size < 1 || tile.size > 4096 || !fits(tile.elevation.size()) || !fits(tile.confidence.size()) ||
      !fits(tile.views.size()) || !fits(tile.kind.size()) || !fits(tile.source.size()) ||
      !fits(tile.gsd.size()) || !fits(tile.angle.size()) ||
      (!tile.color.empty() && tile.color.size() != 4 * n))
    return fail(ErrorCode::BadInput, "the layers of a tile differ in size");
  if (std::adjacent_find(tile.frame_set.begin(), tile.frame_set.end(), std::greater_equal<>()) !=
      tile.frame_set.end())
    return fail(ErrorCode::BadInput, "the frame set of a tile does not ascend");
  return {};
}

// Confidence on fewer levels: 0 stays 0, and nothing else becomes 0.
void coarsen(const std::vector<std::uint8_t>& confidence, int levels, std::vector<std::uint8_t>& coarse) {
  std::uint8_t table[256] = {};
  for (int value = 1; value < 256; ++value) {
    const int level = std::max(1, (value * levels + 127) / 255);
    table[value] = static_cast<std::uint8_t>((level * 255 + levels / 2) / levels);
  }
  coarse.resize(confidence.size());
  std::transform(confidence.begin(), confidence.end(), coarse.begin(),
                 [&](std::uint8_t c) { return table[c]; });
}

Result<EncodedLayer> encodeQuality(const Tile& tile, const EncodeOptions& options) {
  const std::size_t n = tile.texels();
  // Kept for the next tile of the thread.
  thread_local std::vector<std::uint8_t> none, confidence, source_low, source_high;
  none.resize(std::max(none.size(), n), 0);
  const std::span<const std::uint8_t> zero = std::span(none).first(n);
  const auto orZero = [&](const std::vector<std::uint8_t>& plane) {
    return plane.empty() ? zero : std::span<const std::uint8_t>(plane);
  };
  std::span<const std::uint8_t> planes[kPlanes];
  planes[kKind] = tile.kind;
  planes[kConfidence] = orZero(tile.confidence);
  if (!tile.confidence.empty() && options.confidence_levels < 255) {
    coarsen(tile.confidence, options.confidence_levels, confidence);
    planes[kConfidence] = confidence;
  }
  planes[kViews] = orZero(tile.views);
  planes[kGsd] = orZero(tile.gsd);
  planes[kAngle] = orZero(tile.angle);
  source_low.assign(n, Tile::kNoSource & 0xff);
  source_high.assign(n, Tile::kNoSource >> 8);
  for (std::size_t i = 0; i < tile.source.size(); ++i) {
    source_low[i] = static_cast<std::uint8_t>(tile.source[i]);
    source_high[i] = static_cast<std::uint8_t>(tile.source[i] >> 8);
  }
  planes[kSourceLow] = source_low;
  planes[kSourceHigh] = source_high;
  auto bytes = encodePlanes(planes, tile.size, options.elevation.zstd_level);
  if (!bytes) return tl::unexpected(bytes.error());
  EncodedLayer layer{Layer::Quality, Codec::Planes, std::move(*bytes), {}};
  layer.statistics.valid = static_cast<std::uint32_t>(
      std::count_if(tile.kind.begin(), tile.kind.end(), [](auto kind) { return kind != 0; }));
  return layer;
}

Result<void> decodeQuality(std::span<const std::uint8_t> bytes, Tile& tile) {
  auto planes = decodePlanes(bytes, tile.size);
  if (!planes) return tl::unexpected(planes.error());
  if (planes->size() < kAngle) return fail(ErrorCode::Corrupt, "the quality layer lacks planes");
  tile.kind = std::move((*planes)[kKind]);
  tile.confidence = std::move((*planes)[kConfidence]);
  tile.views = std::move((*planes)[kViews]);
  tile.gsd = std::move((*planes)[kGsd]);
  // Maps made before there were angles have one plane less.
  if (planes->size() > kAngle)
    tile.angle = std::move((*planes)[kAngle]);
  else
    tile.angle.assign(tile.texels(), 0);
  tile.source.resize(tile.texels());
  for (std::size_t i = 0; i < tile.source.size(); ++i)
    tile.source[i] = static_cast<std::uint16_t>((*planes)[kSourceLow][i] | (*planes)[kSourceHigh][i] << 8);
  return {};
}

float medianGsd(const Tile& tile) {
  std::size_t count[256] = {}, known = 0;
  for (const std::uint8_t code : tile.gsd) ++count[code];
  for (std::size_t code = 1; code < 256; ++code) known += count[code];
  if (known == 0) return 0;
  std::size_t below = 0, code = 0;
  while (below <= known / 2) below += count[++code];
  return static_cast<float>(gsdFromCode(static_cast<std::uint8_t>(code)));
}

}  // namespace

EncodeOptions encodeOptions(const MapMeta& meta) {
  EncodeOptions options;
  options.elevation.step_m = meta.elevation_step_m;
  return options;
}

Result<TileWrite> encodeTile(const Tile& tile, const EncodeOptions& options,
                             std::span<const float> elevation_max) {
  if (const Result<void> fine = checkTile(tile); !fine) return tl::unexpected(fine.error());
  if (!elevation_max.empty() && elevation_max.size() != tile.texels())
    return fail(ErrorCode::BadInput, "the bound of a tile differs from it in size");
  TileWrite write;
  write.key = tile.key;
  write.frame_set = tile.frame_set;
  write.gsd_m = medianGsd(tile);
  write.provisional = std::any_of(tile.kind.begin(), tile.kind.end(),
                                  [](std::uint8_t kind) { return (kind & kProvisional) != 0; });
  if (!tile.color.empty()) {
    auto picture = encodePicture(tile.color, tile.size, Layer::Color, options.color);
    if (!picture) return tl::unexpected(picture.error());
    write.layers.push_back(std::move(*picture));
  }
  if (!tile.elevation.empty()) {
    auto bytes = encodeHeights(tile.elevation, tile.size, options.elevation);
    if (!bytes) return tl::unexpected(bytes.error());
    // The bound has to hold for what readers decode.
    Tile decoded;
    decoded.size = tile.size;
    decoded.elevation.resize(tile.elevation.size());
    for (std::size_t i = 0; i < tile.elevation.size(); ++i)
      decoded.elevation[i] = quantisedHeight(tile.elevation[i], options.elevation.step_m);
    write.layers.push_back(
        {Layer::Elevation, Codec::Heights, std::move(*bytes), heightStatistics(decoded.elevation)});
    if (options.state) {
      auto exact = encodeExactHeights(tile.elevation, tile.size, options.elevation.zstd_level);
      if (!exact) return tl::unexpected(exact.error());
      write.layers.push_back(
          {Layer::State, Codec::ExactHeights, std::move(*exact), heightStatistics(tile.elevation)});
      // ... with the state or without it.
      for (std::size_t i = 0; i < tile.elevation.size(); ++i)
        decoded.elevation[i] = std::fmax(decoded.elevation[i], tile.elevation[i]);
    }
    std::vector<float> bound = elevationMax(decoded);
    for (std::size_t i = 0; i < elevation_max.size(); ++i) bound[i] = std::fmax(bound[i], elevation_max[i]);
    HeightCoding coarse = options.elevation;
    coarse.step_m *= options.bound_steps;
    auto coded = encodeBound(bound, tile.size, options.bound_block, coarse);
    if (!coded) return tl::unexpected(coded.error());
    write.layers.push_back({Layer::ElevationMax, Codec::Heights, std::move(*coded), heightStatistics(bound)});
  }
  if (!tile.kind.empty()) {
    auto quality = encodeQuality(tile, options);
    if (!quality) return tl::unexpected(quality.error());
    write.layers.push_back(std::move(*quality));
  }
  return write;
}

Result<EncodedLayer> encodePicture(std::span<const std::uint8_t> rgba, int size, Layer layer,
                                   const ColorCoding& coding) {
  auto coded = encodeColor(rgba, size, coding);
  if (!coded) return tl::unexpected(coded.error());
  EncodedLayer encoded{layer, coded->codec, std::move(coded->bytes), {}};
  for (std::size_t i = 3; i < rgba.size(); i += 4) encoded.statistics.valid += rgba[i] != 0 ? 1 : 0;
  return encoded;
}

Result<Tile> decodeTile(const TileInfo& info, std::span<const StoredLayer> layers, int size) {
  Tile tile;
  tile.key = info.key;
  tile.size = size;
  tile.frame_set = info.frame_set;
  for (const StoredLayer& stored : layers) {
    const EncodedLayer& encoded = stored.encoded;
    switch (encoded.layer) {
      case Layer::Color:
      case Layer::Thermal:
      case Layer::NearInfrared: {
        auto color = decodeColor(encoded.codec, encoded.bytes, size);
        if (!color) return tl::unexpected(color.error());
        tile.color = std::move(*color);
        break;
      }
      case Layer::Elevation:
      case Layer::State: {
        auto heights = encoded.codec == Codec::ExactHeights ? decodeExactHeights(encoded.bytes, size)
                                                            : decodeHeights(encoded.bytes, size);
        if (!heights) return tl::unexpected(heights.error());
        tile.elevation = std::move(*heights);
        break;
      }
      case Layer::Quality:
        if (const Result<void> done = decodeQuality(encoded.bytes, tile); !done)
          return tl::unexpected(done.error());
        break;
      case Layer::ElevationMax:
        break;
    }
  }
  return tile;
}

Result<Tile> readTile(const MapReader& reader, const geo::TileKey& key, LayerSet layers) {
  const auto whole = reader.readWhole(key, layers);
  if (!whole) return tl::unexpected(whole.error());
  if (whole->layers.empty())
    return fail(ErrorCode::NotFound, fmt::format("tile {}/{}/{} lacks these layers", key.zoom, key.x, key.y));
  return decodeTile(whole->info, whole->layers, reader.tileSize());
}

Result<Tile> readTopTile(const MapReader& reader, LayerSet layers) {
  const auto whole = reader.readTop(layers);
  if (!whole) return tl::unexpected(whole.error());
  return decodeTile(whole->info, whole->layers, reader.tileSize());
}

Result<std::vector<float>> readElevationMax(const MapReader& reader, const geo::TileKey& key) {
  const auto stored = reader.read(key, Layer::ElevationMax);
  if (!stored) return tl::unexpected(stored.error());
  return decodeBound(stored->encoded.bytes, reader.tileSize());
}

}  // namespace overfly::tiling
