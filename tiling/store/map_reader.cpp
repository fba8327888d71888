#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "tiling/store/detail/rows.h"
#include "tiling/store/detail/schema.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling {
namespace {

using detail::Database;
using detail::Query;
using detail::Transaction;

constexpr int kBusyMs = 5000;
// Rows that one call of changes() looks at, at most: bounds the time of its transaction where a box passes
// few of them.
constexpr std::size_t kMostScanned = 20000;

Result<void> tune(Database& database, const StoreOptions& options) {
  const std::string pragmas = fmt::format(
      "PRAGMA cache_size = -{}; PRAGMA mmap_size = 0; PRAGMA cell_size_check = ON; PRAGMA trusted_schema = "
      "OFF; "
      "PRAGMA query_only = ON;",
      std::max<std::size_t>(options.cache_bytes / 1024, 64));
  return database.execute(pragmas.c_str());
}

tl::unexpected<Error> noTile(const geo::TileKey& key) {
  return fail(ErrorCode::NotFound, fmt::format("no tile {}/{}/{}", key.zoom, key.x, key.y));
}

// Columns revision, codec, checksum, min, max, valid, bytes from `first` on.
Result<StoredLayer> storedLayer(const Query& row, int first, int space, const geo::TileKey& key,
                                Layer layer) {
  StoredLayer stored;
  stored.revision = static_cast<std::uint64_t>(row.integer(first));
  stored.encoded.layer = layer;
  stored.encoded.codec = static_cast<Codec>(row.integer(first + 1));
  const auto expected = static_cast<std::uint32_t>(row.integer(first + 2));
  stored.encoded.statistics = {static_cast<float>(row.real(first + 3)),
                               static_cast<float>(row.real(first + 4)),
                               static_cast<std::uint32_t>(row.integer(first + 5))};
  const auto bytes = row.blob(first + 6);
  if (detail::checksum(space, key, layer, stored.encoded.codec, stored.revision, bytes) != expected)
    return fail(ErrorCode::Corrupt, fmt::format("layer {} of tile {}/{}/{} is damaged on disk", name(layer),
                                                key.zoom, key.x, key.y));
  stored.encoded.bytes.assign(bytes.begin(), bytes.end());
  return stored;
}

PlaneBox boxOf(const geo::TileKey& key) {
  const Eigen::Vector2d corner = geo::TileLattice::planeOf(key),
                        opposite = geo::TileLattice::planeOf(key, 1, 1);
  return {corner.x(), corner.y(), opposite.x(), opposite.y()};
}

Result<TileInfo> tileInfo(const Query& row) {  // zoom, x, y, revision, layers, gsd_m, provisional, frame_set
  TileInfo info;
  info.key = {static_cast<int>(row.integer(0)), row.integer(1), row.integer(2)};
  info.revision = static_cast<std::uint64_t>(row.integer(3));
  info.layers = static_cast<LayerSet>(row.integer(4));
  info.gsd_m = static_cast<float>(row.real(5));
  info.provisional = row.integer(6) != 0;
  auto frame_set = detail::unpackFrameSet(row.blob(7));
  if (!frame_set)
    return fail(ErrorCode::Corrupt, fmt::format("the frame set of tile {}/{}/{} is damaged", info.key.zoom,
                                                info.key.x, info.key.y));
  info.frame_set = std::move(*frame_set);
  return info;
}

}  // namespace

struct MapReader::Impl {
  std::filesystem::path path;
  int tile_size;
  mutable Database database;
};

MapReader::MapReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
MapReader::MapReader(MapReader&&) noexcept = default;
MapReader& MapReader::operator=(MapReader&&) noexcept = default;
MapReader::~MapReader() = default;

Result<MapReader> MapReader::open(const std::filesystem::path& path, const StoreOptions& options) {
  const Result<detail::FileKind> kind = detail::inspect(path);
  if (!kind) return tl::unexpected(kind.error());
  if (*kind == detail::FileKind::Absent)
    return fail(ErrorCode::NotFound, fmt::format("there is no map at {}", path.string()));
  if (*kind == detail::FileKind::Empty)
    return fail(ErrorCode::BadInput, fmt::format("{} is empty; delete it and map again", path.string()));
  const auto finish = [&](Result<Database> database) -> Result<MapReader> {
    if (!database) return tl::unexpected(database.error());
    if (const Result<void> done = detail::checkSchema(*database, path); !done)
      return tl::unexpected(done.error());
    if (const Result<void> done = tune(*database, options); !done) return tl::unexpected(done.error());
    const Result<MapMeta> meta = detail::readMeta(*database);
    if (!meta) return tl::unexpected(meta.error());
    return MapReader(std::make_unique<Impl>(Impl{path, meta->tile_size, std::move(*database)}));
  };
  Result<MapReader> reader = finish(Database::open(path, SQLITE_OPEN_READONLY, options.vfs, kBusyMs));
  if (reader || reader.error().code != ErrorCode::Io) return reader;
  // On a medium that cannot be written SQLite cannot make the log's index; without a log it needs none.
  std::error_code problem;
  const std::uintmax_t log = std::filesystem::file_size(path.string() + "-wal", problem);
  if (!problem && log > 0) return reader;
  return finish(Database::openImmutable(path));
}

Result<MapMeta> MapReader::meta() const { return detail::readMeta(impl_->database); }

int MapReader::tileSize() const { return impl_->tile_size; }

Result<std::uint64_t> MapReader::revision() const { return detail::readRevision(impl_->database); }

Result<StoredLayer> MapReader::read(const geo::TileKey& key, Layer layer) const {
  Query rows = impl_->database.query(
      "SELECT l.revision, codec, checksum, min, max, valid, bytes FROM tile t JOIN layer l ON l.id = t.id * "
      "256 + ? "
      "WHERE space = 0 AND t.zoom = ? AND y = ? AND x = ?");
  rows.bind(static_cast<int>(layer)).bind(key.zoom).bind(key.y).bind(key.x);
  const Result<bool> row = rows.step();
  if (!row) return tl::unexpected(row.error());
  if (!*row || rows.integer(1) == static_cast<int>(Codec::Erased)) return noTile(key);
  return storedLayer(rows, 0, detail::kSpaceLattice, key, layer);
}

namespace {

// The row is as for tileInfo, then the tile's id.
Result<WholeTile> wholeTile(Database& database, const Query& row, int space, LayerSet wanted) {
  Result<TileInfo> info = tileInfo(row);
  if (!info) return tl::unexpected(info.error());
  WholeTile whole{std::move(*info), {}};
  for (const Layer layer : kLayers) {
    if (!contains(wanted, layer)) continue;
    Query rows =
        database.query("SELECT revision, codec, checksum, min, max, valid, bytes FROM layer WHERE id = ?");
    rows.bind(detail::layerRow(row.integer(8), layer));
    const Result<bool> found = rows.step();
    if (!found) return tl::unexpected(found.error());
    if (!*found || rows.integer(1) == static_cast<int>(Codec::Erased)) continue;
    Result<StoredLayer> one = storedLayer(rows, 0, space, whole.info.key, layer);
    if (!one) return tl::unexpected(one.error());
    whole.layers.push_back(std::move(*one));
  }
  return whole;
}

}  // namespace

Result<WholeTile> MapReader::readWhole(const geo::TileKey& key, LayerSet layers) const {
  Result<Transaction> snapshot = Transaction::begin(impl_->database, Transaction::Kind::Read);
  if (!snapshot) return tl::unexpected(snapshot.error());
  Query rows = impl_->database.query(
      "SELECT zoom, x, y, revision, layers, gsd_m, provisional, frame_set, id FROM tile "
      "WHERE space = 0 AND zoom = ? AND y = ? AND x = ?");
  rows.bind(key.zoom).bind(key.y).bind(key.x);
  const Result<bool> row = rows.step();
  if (!row) return tl::unexpected(row.error());
  if (!*row || rows.integer(4) == 0) return noTile(key);
  return wholeTile(impl_->database, rows, detail::kSpaceLattice, layers);
}

Result<std::uint64_t> MapReader::layerRevision(const geo::TileKey& key, Layer layer) const {
  Query rows = impl_->database.query(
      "SELECT l.revision, codec FROM tile t JOIN layer l ON l.id = t.id * 256 + ? "
      "WHERE space = 0 AND t.zoom = ? AND y = ? AND x = ?");
  rows.bind(static_cast<int>(layer)).bind(key.zoom).bind(key.y).bind(key.x);
  const Result<bool> row = rows.step();
  if (!row) return tl::unexpected(row.error());
  if (!*row || rows.integer(1) == static_cast<int>(Codec::Erased)) return noTile(key);
  return static_cast<std::uint64_t>(rows.integer(0));
}

Result<TileInfo> MapReader::info(const geo::TileKey& key) const {
  Query rows = impl_->database.query(
      "SELECT zoom, x, y, revision, layers, gsd_m, provisional, frame_set FROM tile "
      "WHERE space = 0 AND zoom = ? AND y = ? AND x = ?");
  rows.bind(key.zoom).bind(key.y).bind(key.x);
  const Result<bool> row = rows.step();
  if (!row) return tl::unexpected(row.error());
  if (!*row || rows.integer(4) == 0) return noTile(key);
  return tileInfo(rows);
}

Result<WholeTile> MapReader::readTop(LayerSet layers) const {
  Result<Transaction> snapshot = Transaction::begin(impl_->database, Transaction::Kind::Read);
  if (!snapshot) return tl::unexpected(snapshot.error());
  Query rows = impl_->database.query(
      "SELECT zoom, x, y, revision, layers, gsd_m, provisional, frame_set, id FROM tile WHERE space = 1");
  const Result<bool> row = rows.step();
  if (!row) return tl::unexpected(row.error());
  if (!*row) return fail(ErrorCode::NotFound, "the map has no top tile yet");
  return wholeTile(impl_->database, rows, detail::kSpaceTop, layers);
}

Result<ChangePage> MapReader::changes(const ChangeCursor& from, const ChangeFilter& filter, std::size_t limit,
                                      std::uint64_t max_bytes) const {
  ChangePage page;
  page.next = from;
  if (from.done) return page;
  Database& database = impl_->database;
  Result<Transaction> snapshot = Transaction::begin(database, Transaction::Kind::Read);
  if (!snapshot) return tl::unexpected(snapshot.error());
  const Result<std::uint64_t> revision = detail::readRevision(database);
  if (!revision) return tl::unexpected(revision.error());
  ChangeCursor& cursor = page.next;
  if (cursor.until == 0) cursor.until = *revision;
  // A map that was put back from an older copy: nothing here is newer than what the client has.
  if (cursor.since > *revision || cursor.until > *revision)
    return fail(ErrorCode::BadInput,
                fmt::format("revision {} is not of this map (it is at {}); begin again with "
                            "since=0",
                            std::max(cursor.since, cursor.until), *revision));
  if (cursor.revision < cursor.since) cursor.revision = cursor.since;

  std::uint64_t bytes = 0;
  std::size_t scanned = 0;
  int zoom = std::max(cursor.zoom, filter.min_zoom);
  for (;;) {
    {
      Query rows = database.query("SELECT min(zoom) FROM layer WHERE zoom IS NOT NULL AND zoom >= ?");
      rows.bind(zoom);
      const Result<bool> row = rows.step();
      if (!row) return tl::unexpected(row.error());
      if (!*row || rows.isNull(0) || rows.integer(0) > filter.max_zoom) break;
      zoom = static_cast<int>(rows.integer(0));
    }
    if (zoom != cursor.zoom) {
      cursor.zoom = zoom;
      cursor.revision = cursor.since;
    }
    Query rows = database.query(
        "SELECT layer.id & 255, layer.revision, codec, length(bytes), x, y FROM layer JOIN tile ON tile.id = "
        "layer.id "
        ">> 8 WHERE layer.zoom = ? AND layer.revision > ? AND layer.revision <= ? ORDER BY layer.revision, "
        "layer.id");
    rows.bind(zoom).bind(cursor.revision).bind(cursor.until);
    // All layers that one commit gave to a tile share its revision, and no other tile has it.
    std::size_t tile_begin = page.changes.size();
    std::uint64_t tile_revision = cursor.revision, tile_bytes = 0;
    for (;;) {
      const Result<bool> row = rows.step();
      if (!row) return tl::unexpected(row.error());
      const bool next_tile = !*row || static_cast<std::uint64_t>(rows.integer(1)) != tile_revision;
      if (next_tile) {
        if (tile_begin > 0 && bytes + tile_bytes > max_bytes) {
          page.changes.resize(tile_begin);
          return page;
        }
        bytes += tile_bytes;
        tile_bytes = 0;
        tile_begin = page.changes.size();
        cursor.revision = tile_revision;
      }
      if (!*row) break;
      if (next_tile && (page.changes.size() >= limit || ++scanned > kMostScanned)) return page;
      tile_revision = static_cast<std::uint64_t>(rows.integer(1));
      const geo::TileKey key{zoom, rows.integer(4), rows.integer(5)};
      const std::int64_t number = rows.integer(0);
      if (number > 31 || !contains(filter.layers, static_cast<Layer>(number))) continue;
      if (filter.box && !filter.box->intersects(boxOf(key))) continue;
      page.changes.push_back({key, static_cast<Layer>(number), tile_revision,
                              static_cast<std::uint32_t>(rows.integer(3)),
                              rows.integer(2) == static_cast<int>(Codec::Erased)});
      tile_bytes += page.changes.back().bytes;
    }
    ++zoom;
  }
  cursor.done = true;
  return page;
}

Result<std::vector<geo::TileKey>> MapReader::keys(int zoom, Layer layer,
                                                  const std::optional<geo::TileKey>& after,
                                                  std::size_t limit) const {
  constexpr std::int64_t kLowest = std::numeric_limits<std::int64_t>::min();
  Query rows = impl_->database.query(
      "SELECT x, y FROM tile WHERE space = 0 AND zoom = ?1 AND (y, x) > (?2, ?3) AND (layers & ?4) != 0 "
      "ORDER BY y, x LIMIT ?5");
  rows.bind(zoom)
      .bind(after ? after->y : kLowest)
      .bind(after ? after->x : kLowest)
      .bind(std::int64_t{only(layer)})
      .bind(static_cast<std::int64_t>(std::min<std::size_t>(limit, INT32_MAX)));
  std::vector<geo::TileKey> keys;
  for (;;) {
    const Result<bool> row = rows.step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) return keys;
    keys.push_back({zoom, rows.integer(0), rows.integer(1)});
  }
}

Result<PlaneBox> MapReader::bounds(Layer layer) const {
  Database& database = impl_->database;
  const Result<MapMeta> meta = detail::readMeta(database);
  if (!meta) return tl::unexpected(meta.error());
  Query rows = database.query(
      "SELECT zoom, min_x, min_y, max_x, max_y FROM extent WHERE layer = ? ORDER BY zoom DESC");
  rows.bind(static_cast<int>(layer));
  std::optional<PlaneBox> box;
  for (;;) {
    const Result<bool> row = rows.step();
    if (!row) return tl::unexpected(row.error());
    if (!*row || (box && rows.integer(0) < meta->base_zoom)) break;
    const int zoom = static_cast<int>(rows.integer(0));
    const Eigen::Vector2d low = geo::TileLattice::planeOf({zoom, rows.integer(1), rows.integer(2)});
    const Eigen::Vector2d high = geo::TileLattice::planeOf({zoom, rows.integer(3) + 1, rows.integer(4) + 1});
    if (!box) box = PlaneBox{low.x(), low.y(), high.x(), high.y()};
    box->west = std::min(box->west, low.x());
    box->north = std::min(box->north, low.y());
    box->east = std::max(box->east, high.x());
    box->south = std::max(box->south, high.y());
  }
  if (!box) return fail(ErrorCode::NotFound, fmt::format("the map has no {} tile yet", name(layer)));
  return *box;
}

Result<std::pair<int, int>> MapReader::zoomRange(Layer layer) const {
  Query rows = impl_->database.query("SELECT min(zoom), max(zoom) FROM extent WHERE layer = ?");
  rows.bind(static_cast<int>(layer));
  const Result<bool> row = rows.step();
  if (!row) return tl::unexpected(row.error());
  if (!*row || rows.isNull(0))
    return fail(ErrorCode::NotFound, fmt::format("the map has no {} tile yet", name(layer)));
  return std::pair(static_cast<int>(rows.integer(0)), static_cast<int>(rows.integer(1)));
}

Result<StoreStatistics> MapReader::statistics() const {
  Database& database = impl_->database;
  Result<Transaction> snapshot = Transaction::begin(database, Transaction::Kind::Read);
  if (!snapshot) return tl::unexpected(snapshot.error());
  StoreStatistics statistics;
  const Result<std::uint64_t> revision = detail::readRevision(database);
  if (!revision) return tl::unexpected(revision.error());
  statistics.revision = *revision;
  Query extents = database.query(
      "SELECT layer, zoom, min_x, min_y, max_x, max_y, tiles, bytes FROM extent ORDER BY layer, zoom");
  for (;;) {
    const Result<bool> row = extents.step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) break;
    const auto tiles = static_cast<std::uint64_t>(extents.integer(6));
    if (extents.integer(0) == 0) {  // every tile once
      statistics.tiles += tiles;
      continue;
    }
    statistics.levels.push_back({static_cast<Layer>(extents.integer(0)), static_cast<int>(extents.integer(1)),
                                 extents.integer(2), extents.integer(3), extents.integer(4),
                                 extents.integer(5), tiles, static_cast<std::uint64_t>(extents.integer(7))});
  }
  Query frames = database.query("SELECT state, count(*), total(bytes) FROM frame GROUP BY state");
  for (;;) {
    const Result<bool> row = frames.step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) break;
    const auto state = static_cast<std::size_t>(frames.integer(0));
    if (state >= std::size(statistics.frames)) continue;
    statistics.frames[state] = static_cast<std::uint64_t>(frames.integer(1));
    if (state != static_cast<std::size_t>(FrameState::Dropped))
      statistics.frame_bytes += static_cast<std::uint64_t>(frames.real(2));
  }
  const Result<std::int64_t> queued = database.integer("SELECT count(*) FROM queue");
  const Result<std::int64_t> free_pages = database.integer("PRAGMA freelist_count");
  const Result<std::int64_t> page_size = database.integer("PRAGMA page_size");
  if (!queued) return tl::unexpected(queued.error());
  if (!free_pages) return tl::unexpected(free_pages.error());
  if (!page_size) return tl::unexpected(page_size.error());
  statistics.queued = static_cast<std::uint64_t>(*queued);
  statistics.free_bytes = static_cast<std::uint64_t>(*free_pages * *page_size);
  std::error_code problem;
  statistics.file_bytes = std::filesystem::file_size(impl_->path, problem);
  if (problem) statistics.file_bytes = 0;
  statistics.log_bytes = std::filesystem::file_size(impl_->path.string() + "-wal", problem);
  if (problem) statistics.log_bytes = 0;
  return statistics;
}

Result<FrameRecord> MapReader::frame(std::uint64_t id) const {
  static const std::string kSql = fmt::format(
      "SELECT {} FROM frame JOIN camera ON camera.id = camera WHERE frame.id = ?", detail::kFrameColumns);
  Query rows = impl_->database.query(kSql);
  rows.bind(id);
  const Result<bool> row = rows.step();
  if (!row) return tl::unexpected(row.error());
  if (!*row) return fail(ErrorCode::NotFound, fmt::format("the map has no frame {}", id));
  return detail::frameFromRow(rows);
}

Result<std::vector<FrameRecord>> MapReader::frames(std::optional<std::uint64_t> after_id,
                                                   std::size_t limit) const {
  static const std::string kSql = fmt::format(
      "SELECT {} FROM frame JOIN camera ON camera.id = camera WHERE frame.id > ? ORDER BY frame.id LIMIT ?",
      detail::kFrameColumns);
  Query rows = impl_->database.query(kSql);
  rows.bind(after_id ? static_cast<std::int64_t>(*after_id) : std::int64_t{-1})
      .bind(static_cast<std::int64_t>(std::min<std::size_t>(limit, INT32_MAX)));
  std::vector<FrameRecord> frames;
  for (;;) {
    const Result<bool> row = rows.step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) return frames;
    Result<FrameRecord> frame = detail::frameFromRow(rows);
    if (!frame) return tl::unexpected(frame.error());
    frames.push_back(std::move(*frame));
  }
}

Result<std::vector<QueueEntry>> MapReader::queue() const {
  Query rows = impl_->database.query("SELECT zoom, x, y, kind, priority, detail FROM queue");
  std::vector<QueueEntry> entries;
  for (;;) {
    const Result<bool> row = rows.step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) return entries;
    entries.push_back({{static_cast<int>(rows.integer(0)), rows.integer(1), rows.integer(2)},
                       static_cast<int>(rows.integer(3)),
                       rows.real(4),
                       rows.text(5)});
  }
}

Result<std::string> MapReader::value(const std::string& key) const {
  const std::string full = "user." + key;
  Query rows = impl_->database.query("SELECT value FROM meta WHERE key = ?");
  rows.bind(std::string_view(full));
  const Result<bool> row = rows.step();
  if (!row) return tl::unexpected(row.error());
  if (!*row) return fail(ErrorCode::NotFound, fmt::format("the map has no value \"{}\"", key));
  return rows.text(0);
}

Result<std::vector<std::pair<geo::TileKey, Layer>>> MapReader::verify(
    const std::function<bool(std::uint64_t, std::uint64_t)>& progress) const {
  std::vector<std::pair<geo::TileKey, Layer>> damaged;
  const Result<StoreStatistics> totals = statistics();
  if (!totals) return tl::unexpected(totals.error());
  // Per layer and tile, so that one broken chain of pages costs one layer and not the walk.
  std::uint64_t done = 0, total = 0;
  for (const LevelStatistics& level : totals->levels) total += level.tiles;
  for (const LevelStatistics& level : totals->levels) {
    std::optional<geo::TileKey> after;
    for (;;) {
      const Result<std::vector<geo::TileKey>> some = keys(level.zoom, level.layer, after, 256);
      if (!some) return tl::unexpected(some.error());
      if (some->empty()) break;
      for (const geo::TileKey& key : *some) {
        const Result<StoredLayer> stored = read(key, level.layer);
        ++done;
        if (stored || stored.error().code == ErrorCode::NotFound) continue;
        if (stored.error().code != ErrorCode::Corrupt) return tl::unexpected(stored.error());
        damaged.emplace_back(key, level.layer);
      }
      after = some->back();
      if (progress && !progress(done, total)) return damaged;
    }
  }
  return damaged;
}

}  // namespace overfly::tiling
