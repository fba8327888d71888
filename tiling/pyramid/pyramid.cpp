#include "tiling/pyramid/pyramid.h"

#include <algorithm>
#include <array>
#include <optional>
#include <set>
#include <vector>

#include "tiling/clipmap/parent.h"
#include "tiling/pyramid/map_writer.h"
#include "tiling/store/tile_codec.h"

namespace overfly::tiling {

Result<std::size_t> makePyramid(MapStore& store, Layer picture) {
  auto reader = store.reader();
  if (!reader) return tl::unexpected(reader.error());
  MapWriter writer(store);
  const bool own = picture != Layer::Color;
  std::size_t made = 0;
  auto listed = reader->keys(store.meta().base_zoom, picture, {}, SIZE_MAX);
  if (!listed) return tl::unexpected(listed.error());
  std::vector<geo::TileKey> keys = *listed;
  const auto spread = [&] {
    const auto [west, east] =
        std::minmax_element(keys.begin(), keys.end(), [](const auto& a, const auto& b) { return a.x < b.x; });
    const auto [north, south] =
        std::minmax_element(keys.begin(), keys.end(), [](const auto& a, const auto& b) { return a.y < b.y; });
    return std::max(east->x - west->x, south->y - north->y);
  };
  while (!keys.empty() && keys.front().zoom > 0 && spread() > 1) {
    std::set<geo::TileKey> parents;
    for (const geo::TileKey& key : keys) parents.insert(geo::parentOf(key));
    for (const geo::TileKey& parent : parents) {
      std::array<std::optional<Tile>, 4> held;
      std::array<const Tile*, 4> children{};
      for (int i = 0; i < 4; ++i) {
        const auto n = static_cast<std::size_t>(i);
        auto child = readTile(*reader, geo::childOf(parent, i), own ? only(picture) : kTileLayers);
        if (!child && child.error().code != ErrorCode::NotFound) return tl::unexpected(child.error());
        if (child) {
          held[n] = std::move(*child);
          children[n] = &*held[n];
        }
      }
      const Tile tile = makeParent(parent, children);
      if (auto ok = own ? writer.addPicture(tile, picture) : writer.add(tile); !ok)
        return tl::unexpected(ok.error());
      ++made;
    }
    if (auto ok = writer.flush(); !ok) return tl::unexpected(ok.error());
    keys.assign(parents.begin(), parents.end());
  }
  return made;
}

}  // namespace overfly::tiling
