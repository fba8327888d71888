#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "daemon/pull/mirror.h"
#include "tiling/store/detail/sqlite.h"

namespace overfly::pull {
namespace {

using tiling::detail::Database;
using tiling::detail::Query;
using tiling::detail::Transaction;

constexpr int kBusyMs = 5000;

// https://github.com/mapbox/mbtiles-spec, 1.3: rows count from the south. Beside its two tables a third one
// says which revision of the drone's each tile is.
class MbTilesMirror final : public Mirror {
 public:
  MbTilesMirror(std::filesystem::path path, Database database, geo::TileLattice lattice)
      : path_(std::move(path)), database_(std::move(database)), lattice_(std::move(lattice)) {}

  Result<void> prepare(const RemoteMap& remote) {
    if (const auto done = database_.execute(
            "PRAGMA synchronous = FULL; PRAGMA application_id = 1297105496;"
            "CREATE TABLE IF NOT EXISTS metadata (name TEXT PRIMARY KEY, value TEXT);"
            "CREATE TABLE IF NOT EXISTS tiles (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER,"
            " tile_data BLOB, PRIMARY KEY (zoom_level, tile_column, tile_row));"
            "CREATE TABLE IF NOT EXISTS overfly_mirror (zoom, x, y, revision, PRIMARY KEY (zoom, x, y));");
        !done)
      return done;
    const auto mirrored = metadata("overfly_map");
    if (!mirrored) return tl::unexpected(mirrored.error());
    if (mirrored->empty()) {
      const auto tiles = database_.integer("SELECT count(*) FROM (SELECT 1 FROM tiles LIMIT 1)");
      if (!tiles) return tl::unexpected(tiles.error());
      if (*tiles != 0) return refuse(" holds tiles that are not from a mirror");
      const nlohmann::json json{{"tileSize", remote.meta.tile_size}, {"layer", "color"}};
      for (const auto& [name, value] : {std::pair<const char*, std::string>{"name", remote.meta.name},
                                        {"format", "webp"},
                                        {"type", "overlay"},
                                        {"version", "1"},
                                        {"description", "true orthophoto, mirror of map " + remote.id},
                                        {"json", json.dump()},
                                        {"overfly_map", remote.id}})
        if (const auto done = setMetadata(name, value); !done) return done;
    } else if (*mirrored != remote.id) {
      return refuse(" mirrors another map");
    }
    const auto cursor = metadata("overfly_cursor");
    if (!cursor) return tl::unexpected(cursor.error());
    if (!cursor->empty()) cursor_ = *cursor;
    return {};
  }

  Result<void> commit(const MirrorBatch& batch) override {
    auto transaction = Transaction::begin(database_, Transaction::Kind::Write);
    if (!transaction) return tl::unexpected(transaction.error());
    for (const auto& record : batch.records)
      for (const auto& layer : record.layers)
        if (layer.encoded.layer == tiling::Layer::Color)
          if (const auto done = put(record.key, layer); !done) return done;
    if (batch.cursor) {
      if (const auto done = setMetadata("overfly_cursor", *batch.cursor); !done) return done;
      if (const auto done = describe(); !done) return done;
    }
    if (const auto done = transaction->commit(); !done) return done;
    if (batch.cursor) cursor_ = *batch.cursor;
    return {};
  }

  std::uint64_t revisionOf(const LayerKey& what) const override {
    if (what.layer != tiling::Layer::Color) return 0;
    auto& database = const_cast<Database&>(database_);
    Query rows = database.query("SELECT revision FROM overfly_mirror WHERE zoom = ? AND x = ? AND y = ?");
    rows.bind(what.key.zoom).bind(what.key.x).bind(what.key.y);
    const auto row = rows.step();
    return row && *row ? static_cast<std::uint64_t>(rows.integer(0)) : 0;
  }
  std::string cursor() const override { return cursor_; }
  tiling::LayerSet layers() const override { return tiling::only(tiling::Layer::Color); }
  std::filesystem::path path() const override { return path_; }

 private:
  tl::unexpected<Error> refuse(const char* why) const {
    return fail(ErrorCode::BadInput, path_.string() + why + "; name another file");
  }
  Result<std::string> metadata(std::string_view name) {
    Query rows = database_.query("SELECT value FROM metadata WHERE name = ?");
    rows.bind(name);
    const auto row = rows.step();
    if (!row) return tl::unexpected(row.error());
    return *row ? rows.text(0) : std::string();
  }
  Result<void> setMetadata(std::string_view name, std::string_view value) {
    Query insert = database_.query("INSERT OR REPLACE INTO metadata VALUES (?, ?)");
    insert.bind(name).bind(value);
    return insert.run();
  }
  Result<void> put(const geo::TileKey& key, const tiling::StoredLayer& layer) {
    const auto xyz = lattice_.wrapped(key);
    const auto row = (std::int64_t{1} << xyz.zoom) - 1 - xyz.y;
    Query tile =
        database_.query(layer.encoded.codec == tiling::Codec::Erased
                            ? "DELETE FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
                            : "INSERT OR REPLACE INTO tiles VALUES (?, ?, ?, ?)");
    tile.bind(xyz.zoom).bind(xyz.x).bind(row);
    if (layer.encoded.codec != tiling::Codec::Erased)
      tile.bind(std::span<const std::uint8_t>(layer.encoded.bytes));
    if (const auto done = tile.run(); !done) return done;
    Query revision = database_.query("INSERT OR REPLACE INTO overfly_mirror VALUES (?, ?, ?, ?)");
    revision.bind(key.zoom).bind(key.x).bind(key.y).bind(layer.revision);
    return revision.run();
  }
  // What MBTiles readers want to know of the whole: zooms and bounds of the finest one.
  Result<void> describe() {
    Query rows = database_.query(
        "SELECT min(zoom_level), max(zoom_level), min(tile_column), max(tile_column), min(tile_row), "
        "max(tile_row) "
        "FROM tiles WHERE zoom_level = (SELECT max(zoom_level) FROM tiles)");
    const auto row = rows.step();
    if (!row) return tl::unexpected(row.error());
    if (!*row || rows.isNull(0)) return {};
    const int zoom = static_cast<int>(rows.integer(1));
    const auto rows_at_zoom = std::int64_t{1} << zoom;
    const auto corner = [&](std::int64_t x, std::int64_t y) {
      return lattice_.geodeticFromPlane(geo::TileLattice::planeOf({zoom, x, y}));
    };
    const auto nw = corner(rows.integer(2), rows_at_zoom - 1 - rows.integer(5));
    const auto se = corner(rows.integer(3) + 1, rows_at_zoom - rows.integer(4));
    const auto coarsest = database_.integer("SELECT min(zoom_level) FROM tiles");
    if (!coarsest) return tl::unexpected(coarsest.error());
    const double west = geo::degrees(nw.lon), north = geo::degrees(nw.lat), east = geo::degrees(se.lon),
                 south = geo::degrees(se.lat);
    if (const auto done =
            setMetadata("bounds", fmt::format("{:.9f},{:.9f},{:.9f},{:.9f}", west, south, east, north));
        !done)
      return done;
    if (const auto done = setMetadata(
            "center", fmt::format("{:.9f},{:.9f},{}", (west + east) / 2, (south + north) / 2, zoom));
        !done)
      return done;
    if (const auto done = setMetadata("minzoom", std::to_string(*coarsest)); !done) return done;
    return setMetadata("maxzoom", std::to_string(zoom));
  }

  std::filesystem::path path_;
  Database database_;
  geo::TileLattice lattice_;
  std::string cursor_ = "0";
};

}  // namespace

Result<std::unique_ptr<Mirror>> openMbTilesMirror(const std::filesystem::path& file,
                                                  const RemoteMap& remote) {
  auto lattice = geo::TileLattice::parse(remote.meta.lattice);
  if (!lattice) return tl::unexpected(lattice.error());
  if (lattice->kind() != geo::LatticeKind::WebMercator)
    return fail(ErrorCode::BadInput, "the map's lattice is " + remote.meta.lattice +
                                         ", which has no XYZ tiles; pull into a folder instead");
  auto database = Database::open(file, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, {}, kBusyMs);
  if (!database) return tl::unexpected(database.error());
  auto mirror = std::make_unique<MbTilesMirror>(file, std::move(*database), std::move(*lattice));
  if (const auto done = mirror->prepare(remote); !done) return tl::unexpected(done.error());
  return mirror;
}

}  // namespace overfly::pull
