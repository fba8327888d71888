#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <mutex>

#include "render/preview/tile_source.h"

namespace overfly::test {

// A map of known heights for tests and benchmarks: level 0 from a function of the texel, coarser levels as
// the store makes them (means and maxima). Thread-safe.
class SyntheticMap : public preview::TileSource {
 public:
  // Height of a level-0 texel, counted from the map's north-west corner; NaN: no data.
  using Height = std::function<float(int x, int y)>;
  using Color = std::function<std::array<std::uint8_t, 3>(int x, int y)>;
  struct Options {
    geo::TileLattice lattice = geo::TileLattice::webMercator();
    double lat_deg = 47.6712, lon_deg = 9.1743;  // of the north-west corner (moved to a tile's)
    int zoom = 21;
    int tile_size = 64;
    int tiles = 6;  // on each side
    Color color;    // of a level-0 texel; absent: a pattern
  };
  SyntheticMap(const Options& options, Height height);

  [[nodiscard]] Result<preview::MapExtent> extent() override;
  [[nodiscard]] Result<preview::SourceTilePtr> load(const geo::TileKey& key) override;
  [[nodiscard]] Result<std::vector<geo::TileKey>> changes(std::uint64_t& since) override;

  // Makes a level-0 tile of the corner's grid anew from another function, and its parents when `parents`.
  void change(int tile_x, int tile_y, const Height& height, bool parents = true);
  void erase(const geo::TileKey& key);
  // Of tiles that are loaded from now on.
  void setLife(std::optional<std::chrono::nanoseconds> life, std::optional<std::chrono::nanoseconds> grace);

  [[nodiscard]] int texels() const { return options_.tiles * options_.tile_size; }
  [[nodiscard]] const geo::TileKey& corner() const { return corner_; }
  [[nodiscard]] const Options& options() const { return options_; }
  [[nodiscard]] std::uint64_t loads() const { return loads_; }
  // Geodetic place of a level-0 texel position (from the corner), and a height.
  [[nodiscard]] geo::Geodetic place(double x, double y, double height_m) const;

 private:
  void makeTile(int x, int y, const Height& height);
  void makeParent(const geo::TileKey& key);

  Options options_;
  geo::TileKey corner_;
  int levels_ = 0;
  std::mutex mutex_;
  std::map<geo::TileKey, std::shared_ptr<preview::SourceTile>> tiles_;
  std::uint64_t revision_ = 0, loads_ = 0;
  std::map<geo::TileKey, std::uint64_t> erased_;
  std::optional<std::chrono::nanoseconds> life_, grace_;
};

// Rolling hills with walls and boxes as of a town, in metres; no holes.
[[nodiscard]] float townHeight(int x, int y);
// The same with holes and a rim of no data.
[[nodiscard]] float holedHeight(int x, int y);

}  // namespace overfly::test
