#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "capture/geo/tile_lattice.h"
#include "tiling/export/export.h"
#include "tiling/store/tile_codec.h"

namespace overfly::tiling::detail {

// The map as an export sees it.
struct ExportSource {
  const MapReader& reader;
  const ExportOptions& options;
  MapMeta meta;
  geo::TileLattice lattice = geo::TileLattice::webMercator();
  int min_zoom = 0, max_zoom = 0;  // of the layer, max_zoom as chosen

  // Keys of one zoom, in (y, x) order.
  [[nodiscard]] Result<std::vector<geo::TileKey>> keys(int zoom) const;
  // The layer of a tile, decoded and masked as the options say.
  [[nodiscard]] Result<Tile> tile(const geo::TileKey& key) const;
  // "ellipsoid (WGS84)", "geoid (egm96)", ... for metadata.
  [[nodiscard]] std::string datumText(capture::VerticalDatum datum) const;
};
[[nodiscard]] Result<ExportSource> openSource(const MapReader& reader, const ExportOptions& options);

[[nodiscard]] Result<ExportReport> exportGeoTiff(const ExportSource& source, const std::filesystem::path& out,
                                                 const ExportProgress& progress);

// --- web tiles -------------------------------------------------------------------------------------------

enum class WebFormat { Jpeg, Png, Webp };
[[nodiscard]] const char* ending(WebFormat format);

struct WebMetadata {
  std::string name, layer, id, datum;
  WebFormat format = WebFormat::Png;
  int min_zoom = 0, max_zoom = 0, tile_size = 256;
  double west = -180, south = -85, east = 180, north = 85;  // degrees
  std::uint64_t revision = 0;
};

// Takes web tiles and keeps them in some container. Tiles come ordered by zoom and then as `order` asks.
class TileSink {
 public:
  virtual ~TileSink() = default;
  enum class Order { Rows, Hilbert };
  [[nodiscard]] virtual Order order() const { return Order::Rows; }
  [[nodiscard]] virtual Result<void> begin(const WebMetadata& metadata) = 0;
  // XYZ numbering, x wrapped.
  [[nodiscard]] virtual Result<void> add(const geo::TileKey& key, const std::vector<std::uint8_t>& bytes) = 0;
  [[nodiscard]] virtual Result<void> finish() = 0;
};
[[nodiscard]] std::unique_ptr<TileSink> folderSink(const std::filesystem::path& folder);
[[nodiscard]] std::unique_ptr<TileSink> mbTilesSink(const std::filesystem::path& file);
[[nodiscard]] std::unique_ptr<TileSink> pmTilesSink(const std::filesystem::path& file);

[[nodiscard]] Result<ExportReport> exportWebTiles(const ExportSource& source, TileSink& sink,
                                                  const ExportProgress& progress);

// Place of a tile on the Hilbert curve through all zooms (PMTiles v3).
[[nodiscard]] std::uint64_t pmTileId(int zoom, std::uint64_t x, std::uint64_t y);

}  // namespace overfly::tiling::detail
