#include <fmt/format.h>
#include <png.h>
#include <webp/encode.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "tiling/export/detail/source.h"

namespace overfly::tiling::detail {
namespace {

using Bytes = std::vector<std::uint8_t>;

Result<Bytes> png(const Bytes& rgba, int size) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = image.height = static_cast<png_uint_32>(size);
  image.format = PNG_FORMAT_RGBA;
  Bytes bytes(PNG_IMAGE_PNG_SIZE_MAX(image));
  png_alloc_size_t length = bytes.size();
  if (png_image_write_to_memory(&image, bytes.data(), &length, 0, rgba.data(), 4 * size, nullptr) == 0)
    return fail(ErrorCode::Internal, fmt::format("PNG: {}", static_cast<const char*>(image.message)));
  bytes.resize(length);
  return bytes;
}

// Mapzen's Terrarium: metres = 256 R + G + B / 256 - 32768; alpha 0 where there is no data.
Bytes terrarium(const std::vector<float>& heights) {
  Bytes rgba(4 * heights.size());
  for (std::size_t i = 0; i < heights.size(); ++i) {
    if (std::isnan(heights[i])) continue;
    const auto code =
        static_cast<std::uint32_t>(std::clamp(std::lround((heights[i] + 32768.0) * 256), 0L, 0xffffffL));
    rgba[4 * i] = static_cast<std::uint8_t>(code >> 16);
    rgba[4 * i + 1] = static_cast<std::uint8_t>(code >> 8);
    rgba[4 * i + 2] = static_cast<std::uint8_t>(code);
    rgba[4 * i + 3] = 255;
  }
  return rgba;
}

Bytes qualityColors(const Tile& tile) {
  Bytes rgba(4 * tile.texels());
  for (std::size_t i = 0; i < tile.texels(); ++i) {
    if (tile.kind[i] == kNoData) continue;
    const int confidence = tile.confidence[i];
    rgba[4 * i] = static_cast<std::uint8_t>(std::min(255, 2 * (255 - confidence)));
    rgba[4 * i + 1] = static_cast<std::uint8_t>(std::min(255, 2 * confidence));
    rgba[4 * i + 2] = (tile.kind[i] & kMeasured) != 0 ? 0 : 200;
    rgba[4 * i + 3] = 255;
  }
  return rgba;
}

// One format for all tiles of a container: that of the stored tiles when they agree and nothing is masked.
Result<WebFormat> formatFor(const ExportSource& source) {
  if (!isPicture(source.options.layer)) return WebFormat::Png;
  if (source.options.measured_only) return WebFormat::Webp;
  for (int zoom = source.min_zoom; zoom <= source.max_zoom; ++zoom) {
    const auto keys = source.keys(zoom);
    if (!keys) return tl::unexpected(keys.error());
    for (const geo::TileKey& key : *keys) {
      const auto stored = source.reader.read(key, source.options.layer);
      if (stored && stored->encoded.codec != Codec::Jpeg) return WebFormat::Webp;
    }
  }
  return WebFormat::Jpeg;
}

Result<Bytes> webTile(const ExportSource& source, const geo::TileKey& key, WebFormat format) {
  if (isPicture(source.options.layer) && !source.options.measured_only) {
    Result<StoredLayer> stored = source.reader.read(key, source.options.layer);
    if (!stored) return tl::unexpected(stored.error());
    const Codec wanted = format == WebFormat::Jpeg ? Codec::Jpeg : Codec::Webp;
    if (stored->encoded.codec == wanted) return std::move(stored->encoded.bytes);
  }
  const Result<Tile> tile = source.tile(key);
  if (!tile) return tl::unexpected(tile.error());
  if (source.options.layer == Layer::Elevation) return png(terrarium(tile->elevation), tile->size);
  if (source.options.layer == Layer::Quality) return png(qualityColors(*tile), tile->size);
  // Coded a second time: a finer quality than the store's keeps that from showing.
  auto coded = encodeColor(tile->color, tile->size, {ColorFormat::Webp, 92, 4});
  if (!coded) return tl::unexpected(coded.error());
  return std::move(coded->bytes);
}

void placeOf(const ExportSource& source, WebMetadata& metadata) {
  const Result<PlaneBox> box = source.reader.bounds(source.options.layer);
  if (!box) return;
  constexpr double kLast = 1e-12;  // stays within the last cell
  const geo::Geodetic low = source.lattice.geodeticFromPlane({box->west, box->south});
  const geo::Geodetic high = source.lattice.geodeticFromPlane({box->east - kLast, box->north});
  metadata.west = geo::degrees(low.lon);
  metadata.south = geo::degrees(low.lat);
  metadata.east = geo::degrees(high.lon);
  metadata.north = geo::degrees(high.lat);
  if (metadata.west > metadata.east) {  // across the antimeridian: these containers know no such box
    metadata.west = -180;
    metadata.east = 180;
  }
}

}  // namespace

const char* ending(WebFormat format) {
  switch (format) {
    case WebFormat::Jpeg:
      return "jpg";
    case WebFormat::Png:
      return "png";
    case WebFormat::Webp:
      break;
  }
  return "webp";
}

Result<ExportReport> exportWebTiles(const ExportSource& source, TileSink& sink,
                                    const ExportProgress& progress) {
  const Result<WebFormat> format = formatFor(source);
  if (!format) return tl::unexpected(format.error());
  const Result<std::uint64_t> revision = source.reader.revision();
  if (!revision) return tl::unexpected(revision.error());
  WebMetadata metadata;
  metadata.name = source.meta.name.empty() ? "overfly map" : source.meta.name;
  metadata.layer = std::string(name(source.options.layer));
  metadata.id = source.meta.id;
  metadata.datum = source.datumText(source.meta.datum);
  metadata.format = *format;
  metadata.min_zoom = source.min_zoom;
  metadata.max_zoom = source.max_zoom;
  metadata.tile_size = source.meta.tile_size;
  metadata.revision = *revision;
  placeOf(source, metadata);
  if (const Result<void> done = sink.begin(metadata); !done) return tl::unexpected(done.error());

  ExportReport report;
  report.min_zoom = source.min_zoom;
  report.max_zoom = source.max_zoom;
  std::vector<geo::TileKey> all;
  for (int zoom = source.min_zoom; zoom <= source.max_zoom; ++zoom) {
    auto keys = source.keys(zoom);
    if (!keys) return tl::unexpected(keys.error());
    const std::int64_t cells = std::int64_t{1} << zoom;
    std::erase_if(*keys, [&](const geo::TileKey& key) { return key.y < 0 || key.y >= cells; });
    if (sink.order() == TileSink::Order::Hilbert) {
      const auto place = [&](const geo::TileKey& key) {
        const geo::TileKey wrapped = source.lattice.wrapped(key);
        return pmTileId(zoom, static_cast<std::uint64_t>(wrapped.x), static_cast<std::uint64_t>(wrapped.y));
      };
      std::sort(keys->begin(), keys->end(),
                [&](const auto& a, const auto& b) { return place(a) < place(b); });
    }
    all.insert(all.end(), keys->begin(), keys->end());
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Result<Bytes> bytes = webTile(source, all[i], *format);
    if (bytes) {
      if (const Result<void> done = sink.add(source.lattice.wrapped(all[i]), *bytes); !done)
        return tl::unexpected(done.error());
      ++report.tiles;
    } else if (bytes.error().code == ErrorCode::Corrupt) {
      ++report.damaged_tiles;
    } else if (bytes.error().code != ErrorCode::NotFound) {  // erased meanwhile
      return tl::unexpected(bytes.error());
    }
    if (progress && !progress(static_cast<double>(i + 1) / static_cast<double>(all.size())))
      return fail(ErrorCode::Unavailable, "the export was stopped");
  }
  if (const Result<void> done = sink.finish(); !done) return tl::unexpected(done.error());
  return report;
}

}  // namespace overfly::tiling::detail
