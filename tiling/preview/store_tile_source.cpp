#include "tiling/preview/store_tile_source.h"

#include <utility>

#include "tiling/store/codec_heights.h"
#include "tiling/store/tile_codec.h"

namespace overfly::tiling {

Result<std::unique_ptr<StoreTileSource>> StoreTileSource::open(const std::filesystem::path& map) {
  auto tiles = MapReader::open(map);
  if (!tiles) return tl::unexpected(tiles.error());
  auto summary = MapReader::open(map);
  if (!summary) return tl::unexpected(summary.error());
  const auto meta = summary->meta();
  if (!meta) return tl::unexpected(meta.error());
  const auto lattice = geo::TileLattice::parse(meta->lattice);
  if (!lattice) return tl::unexpected(lattice.error());
  return std::unique_ptr<StoreTileSource>(
      new StoreTileSource(std::move(*tiles), std::move(*summary), *lattice));
}

Result<preview::MapExtent> StoreTileSource::extent() {
  const std::scoped_lock lock(summary_mutex_);
  const auto revision = summary_.revision();
  if (!revision) return tl::unexpected(revision.error());
  if (extent_ && extent_->revision == *revision) return *extent_;
  const auto bounds = summary_.bounds(Layer::Elevation);
  if (!bounds) return tl::unexpected(bounds.error());
  const auto zooms = summary_.zoomRange(Layer::Elevation);
  if (!zooms) return tl::unexpected(zooms.error());
  preview::MapExtent extent;
  extent.lattice = lattice_;
  extent.tile_size = summary_.tileSize();
  extent.finest_zoom = zooms->second;
  extent.min = {bounds->west, bounds->north};
  extent.max = {bounds->east, bounds->south};
  extent.revision = *revision;
  extent_ = extent;
  return extent;
}

Result<preview::SourceTilePtr> StoreTileSource::load(const geo::TileKey& key) {
  const std::scoped_lock lock(tiles_mutex_);
  const LayerSet wanted =
      only(Layer::Color) | only(Layer::Elevation) | only(Layer::ElevationMax) | only(Layer::Quality);
  const auto whole = tiles_.readWhole(key, wanted);
  if (!whole) return tl::unexpected(whole.error());
  auto tile = decodeTile(whole->info, whole->layers, tiles_.tileSize());
  if (!tile) return tl::unexpected(tile.error());
  auto out = std::make_shared<preview::SourceTile>();
  out->key = key;
  out->revision = whole->info.revision;
  out->size = tiles_.tileSize();
  out->color = std::move(tile->color);
  out->elevation = std::move(tile->elevation);
  for (const StoredLayer& layer : whole->layers) {
    if (layer.encoded.layer != Layer::ElevationMax) continue;
    auto bound = decodeBound(layer.encoded.bytes, out->size);
    if (!bound) return tl::unexpected(bound.error());
    out->elevation_max = std::move(*bound);
  }
  out->confidence = std::move(tile->confidence);
  return preview::SourceTilePtr(std::move(out));
}

Result<std::vector<geo::TileKey>> StoreTileSource::changes(std::uint64_t& since) {
  const std::scoped_lock lock(tiles_mutex_);
  std::vector<geo::TileKey> keys;
  ChangeCursor cursor = ChangeCursor::after(since);
  ChangeFilter filter;
  filter.layers = only(Layer::Color) | only(Layer::Elevation);
  while (!cursor.done) {
    const auto page = tiles_.changes(cursor, filter, 1000);
    if (!page) return tl::unexpected(page.error());
    for (const Change& change : page->changes)
      if (keys.empty() || keys.back() != change.key) keys.push_back(change.key);
    cursor = page->next;
  }
  since = cursor.until;
  return keys;
}

}  // namespace overfly::tiling
