#include "tiling/clipmap/layout.h"

#include <algorithm>

namespace overfly::tiling {

bool TopTile::hasChild(const geo::TileKey& key) const {
  return key.zoom == north_west.zoom && (key.x == north_west.x || key.x == north_west.x + 1) &&
         (key.y == north_west.y || key.y == north_west.y + 1);
}

Layout::Layout(int base_zoom, const PlaneBox& area) : base_zoom_(base_zoom), area_(area) {
  // In whole indices: the index at level l is that at level 0 shifted right by l, floor for either sign.
  const geo::TileKey low = geo::TileLattice::keyAt({area.west, area.north}, base_zoom);
  const geo::TileKey high = geo::TileLattice::keyAt({area.east, area.south}, base_zoom);
  int level = 0;
  while ((high.x >> level) - (low.x >> level) > 1 || (high.y >> level) - (low.y >> level) > 1) ++level;
  levels_ = level + 2;
  const auto first = [level](std::int64_t low_index, std::int64_t high_index) {
    const std::int64_t a = low_index >> level, b = high_index >> level;
    return a == b ? a & ~std::int64_t{1} : a;  // one cell: with its sibling
  };
  top_ = TopTile{{zoomOf(level), first(low.x, high.x), first(low.y, high.y)}};
}

TileRange Layout::range(int level) const {
  if (!area_) return {zoomOf(level), 0, 0, -1, -1};
  const geo::TileKey low = geo::TileLattice::keyAt({area_->west, area_->north}, base_zoom_);
  const geo::TileKey high = geo::TileLattice::keyAt({area_->east, area_->south}, base_zoom_);
  return {zoomOf(level), low.x >> level, low.y >> level, high.x >> level, high.y >> level};
}

std::optional<geo::TileKey> Layout::parent(const geo::TileKey& key) const {
  const int level = levelOf(key.zoom);
  if (level < 0 || level >= levels_ - 2) return std::nullopt;
  return geo::parentOf(key);
}

Layout Layout::grown(const PlaneBox& area) const {
  if (!area_) return Layout(base_zoom_, area);
  return Layout(base_zoom_, {std::min(area_->west, area.west), std::min(area_->north, area.north),
                             std::max(area_->east, area.east), std::max(area_->south, area.south)});
}

Growth growth(const Layout& before, const Layout& after) {
  Growth result;
  result.added_levels = after.levels() - before.levels();
  result.top_changed = before.top() != after.top();
  if (!before.top()) return result;
  std::vector<geo::TileKey> keys;
  for (int i = 0; i < 4; ++i) keys.push_back(before.top()->child(i));
  for (int level = before.levels() - 1; level <= after.levels() - 2; ++level) {
    for (geo::TileKey& key : keys) key = geo::parentOf(key);
    std::sort(keys.begin(), keys.end());
    keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
    result.parents.insert(result.parents.end(), keys.begin(), keys.end());
  }
  return result;
}

}  // namespace overfly::tiling
