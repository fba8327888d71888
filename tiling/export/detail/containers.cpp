#include <fmt/format.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "tiling/export/detail/source.h"
#include "tiling/store/detail/sqlite.h"

namespace overfly::tiling::detail {
namespace {

nlohmann::json tileJson(const WebMetadata& metadata) {
  nlohmann::json json = {{"tilejson", "3.0.0"},
                         {"name", metadata.name},
                         {"format", ending(metadata.format)},
                         {"minzoom", metadata.min_zoom},
                         {"maxzoom", metadata.max_zoom},
                         {"tileSize", metadata.tile_size},
                         {"scheme", "xyz"},
                         {"bounds", {metadata.west, metadata.south, metadata.east, metadata.north}},
                         {"layer", metadata.layer},
                         {"map_id", metadata.id},
                         {"revision", metadata.revision}};
  if (metadata.layer == "elevation") {
    json["encoding"] = "terrarium";
    json["vertical_datum"] = metadata.datum;
  }
  return json;
}

tl::unexpected<Error> ioError(const std::filesystem::path& path, const std::string& what) {
  return fail(ErrorCode::Io, fmt::format("{}: {}", path.string(), what));
}

class FolderSink : public TileSink {
 public:
  explicit FolderSink(std::filesystem::path folder) : folder_(std::move(folder)) {}

  Result<void> begin(const WebMetadata& metadata) override {
    metadata_ = metadata;
    return {};
  }
  Result<void> add(const geo::TileKey& key, const std::vector<std::uint8_t>& bytes) override {
    const auto column = folder_ / std::to_string(key.zoom) / std::to_string(key.x);
    return write(column / fmt::format("{}.{}", key.y, ending(metadata_.format)), bytes);
  }
  Result<void> finish() override {
    nlohmann::json json = tileJson(metadata_);
    json["tiles"] = {fmt::format("{{z}}/{{x}}/{{y}}.{}", ending(metadata_.format))};
    const std::string text = json.dump(2) + "\n";
    return write(folder_ / "tiles.json", {text.begin(), text.end()});
  }

 private:
  static Result<void> write(const std::filesystem::path& path, const std::vector<std::uint8_t>& bytes) {
    std::error_code problem;
    std::filesystem::create_directories(path.parent_path(), problem);
    if (problem) return ioError(path, problem.message());
    std::ofstream file(path, std::ios::binary);
    file.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    if (!file.flush()) return ioError(path, "cannot be written");
    return {};
  }

  std::filesystem::path folder_;
  WebMetadata metadata_;
};

// https://github.com/mapbox/mbtiles-spec, version 1.3: rows count from the south.
class MbTilesSink : public TileSink {
 public:
  explicit MbTilesSink(std::filesystem::path file) : file_(std::move(file)) {}

  Result<void> begin(const WebMetadata& metadata) override {
    Result<Database> database = Database::open(file_, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, {}, 1000);
    if (!database) return tl::unexpected(database.error());
    database_ = std::make_unique<Database>(std::move(*database));
    if (Result<void> done = database_->execute(
            "PRAGMA application_id = 1297105496; PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; BEGIN;"
            "CREATE TABLE metadata (name TEXT PRIMARY KEY, value TEXT);"
            "CREATE TABLE tiles (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB,"
            " PRIMARY KEY (zoom_level, tile_column, tile_row));");
        !done)
      return done;
    const nlohmann::json json = tileJson(metadata);
    const std::pair<const char*, std::string> rows[] = {
        {"name", metadata.name},
        {"format", ending(metadata.format)},
        {"bounds", fmt::format("{:.9f},{:.9f},{:.9f},{:.9f}", metadata.west, metadata.south, metadata.east,
                               metadata.north)},
        {"center", fmt::format("{:.9f},{:.9f},{}", (metadata.west + metadata.east) / 2,
                               (metadata.south + metadata.north) / 2, metadata.max_zoom)},
        {"minzoom", std::to_string(metadata.min_zoom)},
        {"maxzoom", std::to_string(metadata.max_zoom)},
        {"type", "overlay"},
        {"version", std::to_string(metadata.revision)},
        {"description", fmt::format("{} of map {}", metadata.layer, metadata.id)},
        {"json", json.dump()}};
    for (const auto& [key, value] : rows) {
      Query insert = database_->query("INSERT INTO metadata VALUES (?, ?)");
      insert.bind(std::string_view(key)).bind(std::string_view(value));
      if (Result<void> done = insert.run(); !done) return done;
    }
    return {};
  }
  Result<void> add(const geo::TileKey& key, const std::vector<std::uint8_t>& bytes) override {
    Query insert = database_->query("INSERT OR REPLACE INTO tiles VALUES (?, ?, ?, ?)");
    insert.bind(key.zoom).bind(key.x).bind((std::int64_t{1} << key.zoom) - 1 - key.y);
    insert.bind(std::span<const std::uint8_t>(bytes));
    return insert.run();
  }
  Result<void> finish() override {
    Result<void> done = database_->execute("COMMIT");
    database_.reset();
    return done;
  }

 private:
  std::filesystem::path file_;
  std::unique_ptr<Database> database_;
};

}  // namespace

std::unique_ptr<TileSink> folderSink(const std::filesystem::path& folder) {
  return std::make_unique<FolderSink>(folder);
}
std::unique_ptr<TileSink> mbTilesSink(const std::filesystem::path& file) {
  return std::make_unique<MbTilesSink>(file);
}

}  // namespace overfly::tiling::detail
