#pragma once
#include <Eigen/Core>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "capture/geo/tile_lattice.h"
#include "config/error.h"

namespace overfly::preview {

// One cell of the map as the preview draws it: `size` x `size` texels, row 0 north, column 0 west, sampled at
// their centres. Layers that the map does not have are empty.
struct SourceTile {
  geo::TileKey key;
  std::uint64_t revision = 0;  // grows with every change of the tile
  int size = 0;
  std::vector<std::uint8_t> color;       // RGBA8, alpha 0: no data
  std::vector<float> elevation;          // metres in the map's datum; NaN: no data
  std::vector<float> elevation_max;      // never below this tile's and any finer tile's surface; NaN: no data
  std::vector<std::uint8_t> confidence;  // 0 .. 255
  // How long the tile holds once it was loaded: after `life` a new one should be asked for, and the old one
  // is drawn meanwhile; after `life + grace` it must not be drawn. Absent: until the source says it changed.
  std::optional<std::chrono::nanoseconds> life, grace;
};
using SourceTilePtr = std::shared_ptr<const SourceTile>;

// What the source holds at one moment. It may grow while it is read.
struct MapExtent {
  geo::TileLattice lattice = geo::TileLattice::webMercator();
  int tile_size = 256;                   // a power of two
  int finest_zoom = 0;                   // of the finest tiles there are
  Eigen::Vector2d min{0, 0}, max{0, 0};  // of all tiles, in the lattice's plane coordinates
  std::uint64_t revision = 0;
  friend bool operator==(const MapExtent& a, const MapExtent& b) {
    return a.lattice == b.lattice && a.tile_size == b.tile_size && a.finest_zoom == b.finest_zoom &&
           a.min == b.min && a.max == b.max;  // not the revision: the same place
  }
};

// All that the preview knows of a map: its pyramid of tiles, each zoom made from the next finer one, up to
// the zoom where two by two tiles cover the map. Thread rule: every call may come from any thread.
class TileSource {
 public:
  virtual ~TileSource() = default;
  // NotFound while the map is empty.
  [[nodiscard]] virtual Result<MapExtent> extent() = 0;
  // NotFound: the map has no such tile now; other errors: it cannot be read now.
  [[nodiscard]] virtual Result<SourceTilePtr> load(const geo::TileKey& key) = 0;
  // Tiles that changed after revision `since`, which becomes the revision of the answer.
  [[nodiscard]] virtual Result<std::vector<geo::TileKey>> changes(std::uint64_t& since) = 0;
};

}  // namespace overfly::preview
