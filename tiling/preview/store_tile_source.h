#pragma once
#include <memory>
#include <mutex>
#include <optional>

#include "render/preview/tile_source.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling {

// A stored map's tiles for the preview: colour, elevation, its bound and the confidence. The map may be in
// use and grow. Thread-safe: one reader, one call at a time.
class StoreTileSource : public preview::TileSource {
 public:
  // Unsupported: a map whose meta cannot be understood by this build.
  [[nodiscard]] static Result<std::unique_ptr<StoreTileSource>> create(MapReader reader);

  [[nodiscard]] Result<preview::MapExtent> extent() override;
  [[nodiscard]] Result<preview::SourceTilePtr> load(const geo::TileKey& key) override;
  [[nodiscard]] Result<std::vector<geo::TileKey>> changes(std::uint64_t& since) override;

 private:
  StoreTileSource(MapReader reader, MapMeta meta, geo::TileLattice lattice)
      : reader_(std::move(reader)), meta_(std::move(meta)), lattice_(lattice) {}

  std::mutex mutex_;
  MapReader reader_;
  MapMeta meta_;
  geo::TileLattice lattice_;
  std::optional<preview::MapExtent> extent_;  // as of its revision
};

}  // namespace overfly::tiling
