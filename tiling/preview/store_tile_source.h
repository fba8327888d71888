#pragma once
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>

#include "render/preview/tile_source.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling {

// A stored map's tiles for the preview: colour, elevation, its bound and the confidence. The map may be in
// use and grow. Thread-safe. Two connections: tiles and changes are read one at a time, and whoever asks for
// the extent does not wait for them.
class StoreTileSource : public preview::TileSource {
 public:
  // Errors: MapReader::open's. Unsupported: a map whose meta cannot be understood by this build.
  [[nodiscard]] static Result<std::unique_ptr<StoreTileSource>> open(const std::filesystem::path& map);

  [[nodiscard]] Result<preview::MapExtent> extent() override;
  [[nodiscard]] Result<preview::SourceTilePtr> load(const geo::TileKey& key) override;
  [[nodiscard]] Result<std::vector<geo::TileKey>> changes(std::uint64_t& since) override;

 private:
  StoreTileSource(MapReader tiles, MapReader summary, const geo::TileLattice& lattice)
      : tiles_(std::move(tiles)), summary_(std::move(summary)), lattice_(lattice) {}

  std::mutex tiles_mutex_;
  MapReader tiles_;
  std::mutex summary_mutex_;
  MapReader summary_;
  const geo::TileLattice lattice_;
  std::optional<preview::MapExtent> extent_;  // as of its revision; the summary's
};

}  // namespace overfly::tiling
