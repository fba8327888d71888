#pragma once
#include <cstdint>
#include <filesystem>
#include <list>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "capture/geo/tile_lattice.h"
#include "config/error.h"
#include "daemon/link/detail/parse.h"
#include "daemon/link/detail/raster.h"
#include "tiling/store/map_store.h"

namespace overfly::link {

// A tile of the link: 256 texels, XYZ numbers, whatever the store's own tile size.
struct LinkKey {
  int zoom = 0;
  std::int64_t x = 0, y = 0;
  friend auto operator<=>(const LinkKey&, const LinkKey&) = default;
};

// A square of a stored tile that becomes a square of a link tile, averaged down or interpolated up.
struct Piece {
  geo::TileKey key;  // of the store, unwrapped
  std::uint64_t revision = 0;
  int from_x = 0, from_y = 0, from_side = 0;  // texels of the stored tile
  int to_x = 0, to_y = 0, to_side = 0;        // texels of the link tile
};

// What a link tile is made of; no pieces: nothing is there. Its revisions decide the tile's ETag before
// anything is decoded.
struct Composition {
  std::vector<Piece> pieces;
  [[nodiscard]] std::uint64_t revision() const;
};

// Where a layer is, on the link's terms.
struct Extent {
  DegreeBox box;
  int min_zoom = 0, max_zoom = 0;  // of link tiles
};

// One map as one worker reads it. Bound to its thread.
class MapView {
 public:
  [[nodiscard]] static Result<std::unique_ptr<MapView>> open(const std::filesystem::path& path, int overzoom);

  [[nodiscard]] const tiling::MapMeta& meta() const { return meta_; }
  [[nodiscard]] const tiling::MapReader& reader() const { return reader_; }
  [[nodiscard]] const geo::TileLattice& lattice() const { return lattice_; }
  // Only a Web Mercator map has XYZ tiles; the others go through the export.
  [[nodiscard]] bool isXyz() const { return lattice_.kind() == geo::LatticeKind::WebMercator; }

  [[nodiscard]] std::optional<Extent> extent(tiling::Layer layer) const;
  // Exactly stored, or composed from at most `overzoom` levels away.
  [[nodiscard]] Result<Composition> compose(tiling::Layer layer, const LinkKey& key) const;
  // The stored tile of that place and zoom, whether it is there or not; of the finest zoom there is when
  // `key` is finer.
  [[nodiscard]] std::optional<geo::TileKey> storedKey(const LinkKey& key) const;
  // The stored bytes when the composition is one whole stored tile.
  [[nodiscard]] bool isWhole(const Composition& composition) const;

  [[nodiscard]] Result<Rgba> picture(const Composition& composition, tiling::Layer layer) const;
  [[nodiscard]] Result<Rgba> quality(const Composition& composition) const;  // coloured confidence
  [[nodiscard]] Result<Heights> heights(const Composition& composition) const;
  // With one texel of the neighbours on each side (258 x 258).
  [[nodiscard]] Result<Heights> borderedHeights(const LinkKey& key) const;
  // Of `key` and its eight neighbours: what a hillshade depends on.
  [[nodiscard]] Result<Composition> neighbourhood(const LinkKey& key) const;

  // Lowest and highest height of the map, from its coarsest tiles; nullopt for a map without any.
  [[nodiscard]] std::optional<std::pair<float, float>> heightRange() const;

  struct Height {
    double height_m = 0;
    double gsd_m = 0;    // of the stored tile's source frames; 0: unknown
    double texel_m = 0;  // of the tile that was read
    std::uint64_t revision = 0;
    double confidence = -1;  // 0..1; -1: unknown
    int views = 0;
    std::vector<std::uint64_t> frame_set;
  };
  // Bilinear between texel centres of the finest tile there; NotFound where the map has no height.
  [[nodiscard]] Result<Height> heightAt(double lat, double lon) const;

  // Link boxes to the store's unwrapped plane; nullopt when the box misses the map.
  [[nodiscard]] std::optional<tiling::PlaneBox> planeBox(const DegreeBox& box) const;

 private:
  MapView(tiling::MapReader reader, tiling::MapMeta meta, geo::TileLattice lattice, int overzoom);
  [[nodiscard]] std::int64_t unwrapped(std::int64_t x, int zoom, const tiling::PlaneBox& bounds) const;
  [[nodiscard]] Result<std::shared_ptr<const Heights>> storedHeights(const geo::TileKey& key,
                                                                     std::uint64_t revision) const;
  [[nodiscard]] std::uint64_t storedRevision(const geo::TileKey& key, tiling::Layer layer,
                                             std::optional<Error>& error) const;

  tiling::MapReader reader_;
  tiling::MapMeta meta_;
  geo::TileLattice lattice_;
  int overzoom_;
  int shift_;  // log2(tile size / 256)

  struct CachedHeights {
    geo::TileKey key;
    std::uint64_t revision;
    std::shared_ptr<const Heights> heights;
  };
  mutable std::list<CachedHeights> recent_heights_;  // most recent first
};

}  // namespace overfly::link
