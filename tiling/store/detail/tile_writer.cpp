#include "tiling/store/detail/tile_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "tiling/store/detail/rows.h"

namespace overfly::tiling::detail {

Result<TileWriter::Row> TileWriter::find(int space, const geo::TileKey& key) {
  Query rows =
      database_.query("SELECT id, layers FROM tile WHERE space = ? AND zoom = ? AND y = ? AND x = ?");
  rows.bind(space).bind(key.zoom).bind(key.y).bind(key.x);
  const Result<bool> row = rows.step();
  if (!row) return tl::unexpected(row.error());
  if (!*row) return Row{};
  return Row{rows.integer(0), true, static_cast<LayerSet>(rows.integer(1))};
}

Result<void> TileWriter::dropOtherTops(const geo::TileKey& key) {
  std::vector<std::int64_t> others;
  {
    Query rows =
        database_.query("SELECT id FROM tile WHERE space = 1 AND NOT (zoom = ? AND x = ? AND y = ?)");
    rows.bind(key.zoom).bind(key.x).bind(key.y);
    for (;;) {
      const Result<bool> row = rows.step();
      if (!row) return tl::unexpected(row.error());
      if (!*row) break;
      others.push_back(rows.integer(0));
    }
  }
  for (const std::int64_t id : others) {
    Query layers = database_.query("DELETE FROM layer WHERE id BETWEEN ? AND ?");
    layers.bind(id * 256).bind(id * 256 + 255);
    if (const Result<void> done = layers.run(); !done) return done;
    Query tile = database_.query("DELETE FROM tile WHERE id = ?");
    tile.bind(id);
    if (const Result<void> done = tile.run(); !done) return done;
  }
  return {};
}

void TileWriter::count(int space, const geo::TileKey& key, int layer, std::int64_t tiles,
                       std::int64_t bytes) {
  if (space != kSpaceLattice) return;
  Extent& extent = extents_[{layer, key.zoom}];
  extent.tiles += tiles;
  extent.bytes += bytes;
  if (tiles < 0) {
    extent.shrinks = true;
    return;
  }
  extent.min_x = std::min(extent.min_x, key.x);
  extent.min_y = std::min(extent.min_y, key.y);
  extent.max_x = std::max(extent.max_x, key.x);
  extent.max_y = std::max(extent.max_y, key.y);
}

// False: the layer is already stored with these very bytes.
Result<bool> TileWriter::put(const Row& row, int space, const geo::TileKey& key, const EncodedLayer& layer,
                             std::uint64_t revision) {
  const bool had = row.exists && contains(row.layers, layer.layer);
  std::int64_t old_bytes = 0;
  if (row.exists) {
    Query rows = database_.query(
        "SELECT codec, min, max, valid, length(bytes), bytes, revision, checksum FROM layer WHERE id = ?");
    rows.bind(layerRow(row.id, layer.layer));
    const Result<bool> found = rows.step();
    if (!found) {
      // What is there is damaged and about to be replaced.
      if (found.error().code != ErrorCode::Corrupt) return tl::unexpected(found.error());
    } else if (*found) {
      old_bytes = rows.integer(4);
      const auto bytes = rows.blob(5);
      if (rows.integer(0) == static_cast<int>(layer.codec) && bytes.size() == layer.bytes.size() &&
          std::equal(bytes.begin(), bytes.end(), layer.bytes.begin()) &&
          static_cast<float>(rows.real(1)) == layer.statistics.min &&
          static_cast<float>(rows.real(2)) == layer.statistics.max &&
          static_cast<std::uint32_t>(rows.integer(3)) == layer.statistics.valid &&
          // A row whose checksum is damaged is written anew.
          rows.integer(7) == checksum(space, key, layer.layer, layer.codec,
                                      static_cast<std::uint64_t>(rows.integer(6)), bytes))
        return false;
    }
  }
  if (!std::isfinite(layer.statistics.min) || !std::isfinite(layer.statistics.max))
    return fail(ErrorCode::BadInput, "a layer's statistics must be finite");
  const std::span<const std::uint8_t> bytes(layer.bytes);
  Query insert = database_.query(
      "INSERT OR REPLACE INTO layer (id, zoom, revision, codec, checksum, min, max, valid, bytes) "
      "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.bind(layerRow(row.id, layer.layer));
  space == kSpaceLattice ? insert.bind(key.zoom) : insert.bindNull();
  insert.bind(revision)
      .bind(static_cast<int>(layer.codec))
      .bind(std::int64_t{checksum(space, key, layer.layer, layer.codec, revision, bytes)})
      .bind(double{layer.statistics.min})
      .bind(double{layer.statistics.max})
      .bind(std::int64_t{layer.statistics.valid})
      .bind(bytes);
  if (const Result<void> done = insert.run(); !done) return tl::unexpected(done.error());
  const bool has = layer.codec != Codec::Erased;
  count(space, key, static_cast<int>(layer.layer), int{has} - int{had},
        static_cast<std::int64_t>(layer.bytes.size()) - old_bytes);
  return true;
}

Result<void> TileWriter::write(const TileWrite& tile) {
  const geo::TileKey& key = tile.key;
  constexpr std::int64_t kFar = std::int64_t{1} << 52;  // exact as a double
  if (key.zoom < 0 || key.zoom > 63 || std::abs(key.x) > kFar || std::abs(key.y) > kFar)
    return fail(ErrorCode::BadInput, fmt::format("no tile can lie at {}/{}/{}", key.zoom, key.x, key.y));
  const int space = tile.top ? kSpaceTop : kSpaceLattice;
  if (tile.top)
    if (const Result<void> done = dropOtherTops(key); !done) return done;
  Result<Row> row = find(space, key);
  if (!row) return tl::unexpected(row.error());
  if (tile.erase && !row->exists) return {};
  const bool fresh = !row->exists;
  const std::vector<std::uint8_t> frame_set = packFrameSet(tile.frame_set);
  if (fresh) {
    Query insert = database_.query(
        "INSERT INTO tile (space, zoom, x, y, revision, layers, gsd_m, provisional, frame_set) "
        "VALUES (?, ?, ?, ?, 0, 0, 0, 0, x'')");
    insert.bind(space).bind(key.zoom).bind(key.x).bind(key.y);
    if (const Result<void> done = insert.run(); !done) return done;
    row->id = sqlite3_last_insert_rowid(database_.handle());
  }
  row->exists = !fresh;

  std::vector<EncodedLayer> erased;
  if (tile.erase)
    for (const Layer layer : kLayers)
      if (contains(row->layers, layer)) erased.push_back({layer, Codec::Erased, {}, {}});
  const std::vector<EncodedLayer>& layers = tile.erase ? erased : tile.layers;

  const std::uint64_t next = revision_ + 1;
  bool changed = false;
  LayerSet now = row->layers;
  for (const EncodedLayer& layer : layers) {
    const Result<bool> put_one = put(*row, space, key, layer, next);
    if (!put_one) return tl::unexpected(put_one.error());
    changed = changed || *put_one;
    if (layer.codec == Codec::Erased)
      now &= ~only(layer.layer);
    else
      now |= only(layer.layer);
  }
  if (changed) {
    count(space, key, 0, int{now != 0} - int{row->layers != 0}, 0);
    revision_ = next;
    changed_.push_back(key);
    Query update = database_.query(
        "UPDATE tile SET revision = ?, layers = ?, gsd_m = ?, provisional = ?, frame_set = ? WHERE id = ?");
    update.bind(next)
        .bind(std::int64_t{now})
        .bind(double{tile.gsd_m})
        .bind(static_cast<int>(tile.provisional));
    update.bind(std::span<const std::uint8_t>(frame_set)).bind(row->id);
    return update.run();
  }
  // The same picture from other frames: mirrors need not hear of it.
  Query update = database_.query("UPDATE tile SET gsd_m = ?, provisional = ?, frame_set = ? WHERE id = ?");
  update.bind(double{tile.gsd_m}).bind(static_cast<int>(tile.provisional));
  update.bind(std::span<const std::uint8_t>(frame_set)).bind(row->id);
  return update.run();
}

Result<void> TileWriter::finish() {
  for (const auto& [place, extent] : extents_) {
    const auto& [layer, zoom] = place;
    Query upsert = database_.query(
        "INSERT INTO extent VALUES (?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT DO UPDATE SET "
        "min_x = min(min_x, excluded.min_x), min_y = min(min_y, excluded.min_y), "
        "max_x = max(max_x, excluded.max_x), max_y = max(max_y, excluded.max_y), "
        "tiles = tiles + excluded.tiles, bytes = bytes + excluded.bytes");
    upsert.bind(layer).bind(zoom).bind(extent.min_x).bind(extent.min_y).bind(extent.max_x).bind(extent.max_y);
    upsert.bind(extent.tiles).bind(extent.bytes);
    if (const Result<void> done = upsert.run(); !done) return done;
    if (!extent.shrinks) continue;
    Query remove = database_.query("DELETE FROM extent WHERE layer = ? AND zoom = ? AND tiles <= 0");
    remove.bind(layer).bind(zoom);
    if (const Result<void> done = remove.run(); !done) return done;
    Query shrink = database_.query(
        "UPDATE extent SET (min_x, min_y, max_x, max_y) = (SELECT min(x), min(y), max(x), max(y) FROM tile "
        "WHERE space = 0 AND zoom = extent.zoom AND (layers & ?1) != 0) WHERE layer = ?2 AND zoom = ?3");
    const LayerSet mask = layer == 0 ? kAllLayers : LayerSet{1} << layer;
    shrink.bind(std::int64_t{mask}).bind(layer).bind(zoom);
    if (const Result<void> done = shrink.run(); !done) return done;
  }
  Query update = database_.query("UPDATE meta SET value = ? WHERE key = 'revision'");
  update.bind(revision_);
  return update.run();
}

}  // namespace overfly::tiling::detail
