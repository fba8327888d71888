#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "capture/geo/tile_lattice.h"
#include "tiling/plane_box.h"

namespace overfly::tiling {

// Inclusive range of cells of one zoom.
struct TileRange {
  int zoom = 0;
  std::int64_t min_x = 0, min_y = 0, max_x = 0, max_y = 0;
  [[nodiscard]] bool contains(const geo::TileKey& key) const {
    return key.zoom == zoom && key.x >= min_x && key.x <= max_x && key.y >= min_y && key.y <= max_y;
  }
  friend bool operator==(const TileRange&, const TileRange&) = default;
};

// The special tile of level L-1 that covers the whole area by 2x2 children of level L-2 (3.2.4), wherever
// these lie: its children need not be one cell's of the lattice. It is derived, never an XYZ tile.
struct TopTile {
  geo::TileKey north_west;  // the first of its children
  // Child i: bit 0 east, bit 1 south, as childOf().
  [[nodiscard]] geo::TileKey child(int i) const {
    return {north_west.zoom, north_west.x + (i & 1), north_west.y + ((i >> 1) & 1)};
  }
  [[nodiscard]] bool hasChild(const geo::TileKey& key) const;
  // The name under which the store keeps it, in a space of its own: its children's zoom - 1, and the index of
  // its north-west child. (The thesis calls every top tile (0, 0).)
  [[nodiscard]] geo::TileKey key() const { return {north_west.zoom - 1, north_west.x, north_west.y}; }
  friend bool operator==(const TopTile&, const TopTile&) = default;
};

// The levels of the Flexible Clipmap over an area (thesis, 3.2.4). Level l lies at zoom z0 - l; cells are
// those of the lattice at every level below the top, so a tile's index never depends on the area (3.1).
//
// Number of levels: l' is the smallest level at which the corners' indices differ by at most 1 on both axes,
// L = l' + 2. Equations (3.2) and (3.3) ask for a largest difference of exactly 1 at l' or above an estimate,
// which about half of all areas far from the origin never meet: there the difference is 0 already.
//
// Where only one column (or row) of cells is covered, the missing column is the one that shares the lattice's
// parent with it: so the top tile of an area within one parent is that parent's ground.
//
// Value type, reentrant; knows no disk and no GPU.
class Layout {
 public:
  // Nothing covered: no levels, no top.
  explicit Layout(int base_zoom) : base_zoom_(base_zoom) {}
  Layout(int base_zoom, const PlaneBox& area);

  [[nodiscard]] int baseZoom() const { return base_zoom_; }
  [[nodiscard]] const std::optional<PlaneBox>& area() const { return area_; }
  [[nodiscard]] int levels() const { return levels_; }  // L; 0 when nothing is covered, else at least 2
  [[nodiscard]] int zoomOf(int level) const { return base_zoom_ - level; }
  [[nodiscard]] int levelOf(int zoom) const { return base_zoom_ - zoom; }
  [[nodiscard]] const std::optional<TopTile>& top() const { return top_; }

  // Cells of a level 0 .. L-2 that the area covers, its border included (figure 3.10); outside it every tile
  // is empty and is not stored.
  [[nodiscard]] TileRange range(int level) const;
  // (3.5) below level L-2; nullopt where the parent is the top tile, and outside the levels.
  [[nodiscard]] std::optional<geo::TileKey> parent(const geo::TileKey& key) const;

  // The layout of the union of both areas.
  [[nodiscard]] Layout grown(const PlaneBox& area) const;

 private:
  int base_zoom_ = 0;
  int levels_ = 0;
  std::optional<PlaneBox> area_;
  std::optional<TopTile> top_;
};

// What a growth from one layout to a larger one asks for (figures 3.8, 3.9). All tiles keep their indices;
// the former top tile is discarded when it changes.
struct Growth {
  int added_levels = 0;
  bool top_changed = false;  // to be made anew from its children
  // Lattice tiles at the new levels that the former top's children belong to, lower levels first. At most
  // four a level; those without a stored child stay empty.
  std::vector<geo::TileKey> parents;
};
[[nodiscard]] Growth growth(const Layout& before, const Layout& after);

}  // namespace overfly::tiling
