#include <charconv>
#include <map>
#include <nlohmann/json.hpp>

#include "daemon/pull/mirror.h"

namespace overfly::pull {
namespace {

constexpr const char* kMapMember = "mirror_of";    // of MapMeta::extra: the id of the drone's map
constexpr const char* kCursorKey = "pull.cursor";  // of the store's key-value pairs

std::string revisionKey(const LayerKey& what) {
  return "pull.revision." + link::text(link::WantedTile{what.layer, what.key});
}

class MapMirror final : public Mirror {
 public:
  MapMirror(tiling::MapStore store, tiling::MapReader reader, std::string cursor)
      : store_(std::move(store)), reader_(std::move(reader)), cursor_(std::move(cursor)) {}

  Result<void> commit(const MirrorBatch& batch) override {
    tiling::Batch out;
    // One write a tile: layers of it that came in several records go together.
    std::map<geo::TileKey, tiling::TileWrite> tiles;
    for (const auto& record : batch.records) {
      auto& tile = tiles[record.key];
      tile.key = record.key;
      if (record.gsd_m > 0) tile.gsd_m = record.gsd_m;
      tile.provisional = record.provisional;
      for (const auto& layer : record.layers) {
        std::erase_if(tile.layers, [&](const auto& other) { return other.layer == layer.encoded.layer; });
        tile.layers.push_back(layer.encoded);
        out.values.emplace_back(revisionKey({record.key, layer.encoded.layer}),
                                std::to_string(layer.revision));
      }
    }
    for (auto& [key, tile] : tiles) out.tiles.push_back(std::move(tile));
    out.frames = batch.frames;
    if (batch.cursor) out.values.emplace_back(kCursorKey, *batch.cursor);
    if (const auto done = store_.commit(out); !done) return tl::unexpected(done.error());
    if (batch.cursor) cursor_ = *batch.cursor;
    return {};
  }

  std::uint64_t revisionOf(const LayerKey& what) const override {
    const auto text = reader_.value(revisionKey(what));
    std::uint64_t revision = 0;
    if (text) std::from_chars(text->data(), text->data() + text->size(), revision);
    return revision;
  }
  std::string cursor() const override { return cursor_; }
  tiling::LayerSet layers() const override { return tiling::kAllLayers; }
  std::filesystem::path path() const override { return store_.path(); }

 private:
  tiling::MapStore store_;
  tiling::MapReader reader_;
  std::string cursor_;
};

// Letters that may stand in a file's name, whatever the drone sends.
std::string fileName(const std::string& mission) {
  std::string out;
  for (const char c : mission.substr(0, 100))
    out += std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_' || (c == '.' && !out.empty())
               ? c
               : '_';
  return out.empty() ? "map" : out;
}

}  // namespace

Result<std::unique_ptr<Mirror>> openMapMirror(const std::filesystem::path& folder, const RemoteMap& remote) {
  std::error_code problem;
  std::filesystem::create_directories(folder, problem);
  if (problem) return fail(ErrorCode::Io, "cannot make " + folder.string() + ": " + problem.message());
  const auto path = folder / (fileName(remote.mission) + ".overfly");
  auto store = tiling::MapStore::open(path);
  if (!store && store.error().code == ErrorCode::NotFound) {
    auto meta = remote.meta;
    meta.id.clear();  // revisions here are the mirror's own, and so is the id that goes into entity tags
    meta.extra = nlohmann::json{{kMapMember, remote.id}}.dump();
    store = tiling::MapStore::create(path, meta);
  }
  if (!store) return tl::unexpected(store.error());
  auto reader = store->reader();
  if (!reader) return tl::unexpected(reader.error());
  const auto extra = nlohmann::json::parse(store->meta().extra, nullptr, false);
  const bool is_mirror = extra.is_object() && extra.contains(kMapMember);
  if (!is_mirror || extra[kMapMember] != remote.id)
    return fail(ErrorCode::BadInput, path.string() + (is_mirror ? " mirrors another map" : " is no mirror") +
                                         "; pull into another folder, or move it away");
  auto cursor = reader->value(kCursorKey);
  return std::make_unique<MapMirror>(std::move(*store), std::move(*reader), cursor ? *cursor : "0");
}

}  // namespace overfly::pull
