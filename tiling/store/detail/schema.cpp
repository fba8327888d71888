#include "tiling/store/detail/schema.h"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <fstream>

namespace overfly::tiling::detail {
namespace {

constexpr const char* kTables = R"sql(
CREATE TABLE meta (key TEXT PRIMARY KEY, value NOT NULL) WITHOUT ROWID;
CREATE TABLE tile (
  id INTEGER PRIMARY KEY, space INTEGER NOT NULL, zoom INTEGER NOT NULL, x INTEGER NOT NULL,
  y INTEGER NOT NULL, revision INTEGER NOT NULL, layers INTEGER NOT NULL, gsd_m REAL NOT NULL,
  provisional INTEGER NOT NULL, frame_set BLOB NOT NULL);
CREATE UNIQUE INDEX tile_key ON tile (space, zoom, y, x);
CREATE TABLE layer (
  id INTEGER PRIMARY KEY, zoom INTEGER, revision INTEGER NOT NULL, codec INTEGER NOT NULL, checksum INTEGER NOT NULL,
  min REAL NOT NULL, max REAL NOT NULL, valid INTEGER NOT NULL, bytes BLOB NOT NULL);
CREATE INDEX layer_change ON layer (zoom, revision) WHERE zoom IS NOT NULL;
CREATE TABLE extent (
  layer INTEGER NOT NULL, zoom INTEGER NOT NULL, min_x INTEGER NOT NULL, min_y INTEGER NOT NULL,
  max_x INTEGER NOT NULL, max_y INTEGER NOT NULL, tiles INTEGER NOT NULL, bytes INTEGER NOT NULL,
  PRIMARY KEY (layer, zoom)) WITHOUT ROWID;
CREATE TABLE camera (id INTEGER PRIMARY KEY, model TEXT NOT NULL UNIQUE);
CREATE TABLE frame (
  id INTEGER PRIMARY KEY, name TEXT NOT NULL, camera_id TEXT NOT NULL, camera INTEGER NOT NULL,
  time_ns INTEGER NOT NULL, utc_offset_ns INTEGER NOT NULL, exposure_ns INTEGER NOT NULL,
  datum INTEGER NOT NULL, pose_is_adjusted INTEGER NOT NULL, pose BLOB, footprint BLOB,
  west REAL, north REAL, east REAL, south REAL,
  path TEXT NOT NULL, bytes INTEGER NOT NULL, state INTEGER NOT NULL, reason TEXT NOT NULL);
CREATE INDEX frame_state ON frame (state, bytes);
CREATE TABLE queue (
  kind INTEGER NOT NULL, zoom INTEGER NOT NULL, x INTEGER NOT NULL, y INTEGER NOT NULL,
  priority REAL NOT NULL, detail TEXT NOT NULL, PRIMARY KEY (kind, zoom, x, y)) WITHOUT ROWID;
)sql";

constexpr std::array kTableNames{"camera", "extent", "frame", "layer", "meta", "queue", "tile"};

// What takes a map from version i + 1 to i + 2: the next format change adds its statements here.
constexpr std::array<const char*, kSchemaVersion - 1> kMigrations{};

std::uint32_t bigEndian(const std::array<char, 100>& header, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<unsigned char>(header[at + i]);
  return value;
}

tl::unexpected<Error> torn(const std::filesystem::path& path, const std::string& what) {
  return fail(ErrorCode::Corrupt,
              fmt::format("{} is a damaged map ({}): restore it from a copy, or move it away and let the "
                          "recorded flight be mapped again",
                          path.string(), what));
}

const char* datumText(capture::VerticalDatum datum) {
  switch (datum) {
    case capture::VerticalDatum::Ellipsoid:
      return "ellipsoid";
    case capture::VerticalDatum::Geoid:
      return "geoid";
    case capture::VerticalDatum::Home:
      return "home";
    case capture::VerticalDatum::Unknown:
      break;
  }
  return "unknown";
}

capture::VerticalDatum datumFrom(const std::string& text) {
  using enum capture::VerticalDatum;
  return text == "ellipsoid" ? Ellipsoid : text == "geoid" ? Geoid : text == "home" ? Home : Unknown;
}

Result<std::string> metaText(Database& database, std::string_view key) {
  Query rows = database.query("SELECT value FROM meta WHERE key = ?");
  rows.bind(key);
  const Result<bool> row = rows.step();
  if (!row) return tl::unexpected(row.error());
  if (!*row) return fail(ErrorCode::Corrupt, fmt::format("the map lacks \"{}\"", key));
  return rows.text(0);
}

Result<void> checkWhole(Database& database, const std::filesystem::path& path) {
  const Result<std::int64_t> application = database.integer("PRAGMA application_id");
  if (!application) return tl::unexpected(application.error());
  if (*application != kApplicationId)
    return fail(ErrorCode::BadInput,
                fmt::format("{} is not an overfly map; name another file", path.string()));
  const Result<std::int64_t> version = database.integer("PRAGMA user_version");
  if (!version) return tl::unexpected(version.error());
  if (*version > kSchemaVersion || *version < 1)
    return fail(ErrorCode::BadInput,
                fmt::format("{} was made by another version of overfly (format {}, this one reads 1 to {}): "
                            "install the newer overfly",
                            path.string(), *version, kSchemaVersion));
  std::size_t found = 0;
  Query tables = database.query("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name");
  for (;;) {
    const Result<bool> row = tables.step();
    if (!row) return tl::unexpected(row.error());
    if (!*row) break;
    if (found < kTableNames.size() && tables.text(0) == kTableNames[found]) ++found;
  }
  if (found != kTableNames.size())
    return fail(ErrorCode::Corrupt, fmt::format("no table \"{}\"", kTableNames[found]));
  const Result<MapMeta> meta = readMeta(database);
  const Result<std::uint64_t> revision = readRevision(database);
  if (!meta) return tl::unexpected(meta.error());
  if (!revision) return tl::unexpected(revision.error());
  return {};
}

}  // namespace

Result<FileKind> inspect(const std::filesystem::path& path) {
  std::error_code problem;
  const auto status = std::filesystem::status(path, problem);
  if (status.type() == std::filesystem::file_type::not_found) return FileKind::Absent;
  if (problem) return fail(ErrorCode::Io, fmt::format("{}: {}", path.string(), problem.message()));
  if (status.type() != std::filesystem::file_type::regular)
    return fail(ErrorCode::BadInput,
                fmt::format("{} is not a file; name the map's .overfly file", path.string()));
  std::ifstream file(path, std::ios::binary);
  if (!file) return fail(ErrorCode::Io, fmt::format("{}: {}", path.string(), std::strerror(errno)));
  std::array<char, 100> header{};
  file.read(header.data(), header.size());
  if (file.gcount() == 0) return FileKind::Empty;
  const bool sqlite = file.gcount() == 100 && std::memcmp(header.data(), "SQLite format 3", 16) == 0;
  const std::uint32_t application = bigEndian(header, 68);
  if (sqlite && application == kApplicationId) return FileKind::Map;
  return fail(
      ErrorCode::BadInput,
      fmt::format("{} is not an overfly map; name another file (it was left as it is)", path.string()));
}

Result<void> createSchema(Database& database, const MapMeta& meta) {
  // Larger than SQLite's default: a coded layer is 1 to 40 kB and then lies in few pages. secure_delete is
  // compiled in on Debian and would write every freed page once more, as zeros.
  Result<void> done = database.execute("PRAGMA page_size = 8192; PRAGMA secure_delete = OFF;");
  if (!done) return done;
  const Result<std::int64_t> objects = database.integer("SELECT count(*) FROM sqlite_schema");
  if (!objects) return tl::unexpected(objects.error());
  if (*objects != 0) return fail(ErrorCode::BadInput, "the file holds another database; name another file");
  Result<Transaction> transaction = Transaction::begin(database, Transaction::Kind::Write);
  if (!transaction) return tl::unexpected(transaction.error());
  if (done = database.execute(kTables); !done) return done;
  if (done = database.query("INSERT INTO meta VALUES ('revision', 0)").run(); !done) return done;
  if (done = writeMeta(database, meta); !done) return done;
  const std::string ids =
      fmt::format("PRAGMA application_id = {}; PRAGMA user_version = {}", kApplicationId, kSchemaVersion);
  if (done = database.execute(ids.c_str()); !done) return done;
  if (done = transaction->commit(); !done) return done;
  return database.execute("PRAGMA journal_mode = WAL");
}

Result<void> checkSchema(Database& database, const std::filesystem::path& path) {
  Result<void> whole = checkWhole(database, path);
  if (!whole && whole.error().code == ErrorCode::Corrupt) return torn(path, whole.error().message);
  return whole;
}

Result<void> migrate(Database& database, const std::filesystem::path& path) {
  for (;;) {
    const Result<std::int64_t> version = database.integer("PRAGMA user_version");
    if (!version) return tl::unexpected(version.error());
    if (*version >= kSchemaVersion) return checkSchema(database, path);
    if (*version < 1) return torn(path, "no schema version");
    Result<Transaction> transaction = Transaction::begin(database, Transaction::Kind::Write);
    if (!transaction) return tl::unexpected(transaction.error());
    if (const Result<void> done = database.execute(kMigrations[static_cast<std::size_t>(*version - 1)]);
        !done)
      return done;
    const std::string next = fmt::format("PRAGMA user_version = {}", *version + 1);
    if (const Result<void> done = database.execute(next.c_str()); !done) return done;
    if (const Result<void> done = transaction->commit(); !done) return done;
  }
}

Result<MapMeta> readMeta(Database& database) {
  MapMeta meta;
  std::string datum, tile_size, base_zoom, step, created;
  const std::pair<const char*, std::string*> fields[] = {{"map.id", &meta.id},
                                                         {"map.name", &meta.name},
                                                         {"map.lattice", &meta.lattice},
                                                         {"map.geoid", &meta.geoid},
                                                         {"map.extra", &meta.extra},
                                                         {"map.datum", &datum},
                                                         {"map.tile_size", &tile_size},
                                                         {"map.base_zoom", &base_zoom},
                                                         {"map.elevation_step_um", &step},
                                                         {"map.created_utc_ns", &created}};
  for (const auto& [key, field] : fields) {
    Result<std::string> text = metaText(database, key);
    if (!text) return tl::unexpected(text.error());
    *field = std::move(*text);
  }
  const auto number = [](const std::string& text) {
    std::int64_t value = 0;
    std::from_chars(text.data(), text.data() + text.size(), value);
    return value;
  };
  meta.datum = datumFrom(datum);
  meta.tile_size = static_cast<int>(number(tile_size));
  meta.base_zoom = static_cast<int>(number(base_zoom));
  meta.elevation_step_m = static_cast<double>(number(step)) * 1e-6;
  meta.created_utc_ns = number(created);
  if (meta.tile_size < 1 || meta.tile_size > 4096 || meta.elevation_step_m <= 0)
    return fail(ErrorCode::Corrupt, "the map's tile size or elevation step is out of range");
  return meta;
}

Result<void> writeMeta(Database& database, const MapMeta& meta) {
  const auto micrometres = static_cast<std::int64_t>(meta.elevation_step_m * 1e6 + 0.5);
  const std::pair<const char*, std::string> fields[] = {
      {"map.id", meta.id},
      {"map.name", meta.name},
      {"map.lattice", meta.lattice},
      {"map.geoid", meta.geoid},
      {"map.extra", meta.extra},
      {"map.datum", datumText(meta.datum)},
      {"map.tile_size", std::to_string(meta.tile_size)},
      {"map.base_zoom", std::to_string(meta.base_zoom)},
      {"map.elevation_step_um", std::to_string(micrometres)},
      {"map.created_utc_ns", std::to_string(meta.created_utc_ns)}};
  for (const auto& [key, value] : fields) {
    Query insert = database.query("INSERT OR REPLACE INTO meta VALUES (?, ?)");
    insert.bind(std::string_view(key)).bind(std::string_view(value));
    if (const Result<void> done = insert.run(); !done) return done;
  }
  return {};
}

Result<std::uint64_t> readRevision(Database& database) {
  const Result<std::int64_t> value = database.integer("SELECT value FROM meta WHERE key = 'revision'");
  if (!value && value.error().code == ErrorCode::NotFound)
    return fail(ErrorCode::Corrupt, "the map lacks its revision");
  if (!value) return tl::unexpected(value.error());
  return static_cast<std::uint64_t>(*value);
}

}  // namespace overfly::tiling::detail
