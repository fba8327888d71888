#pragma once
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "tiling/store/detail/sqlite.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling::detail {

// Writes the tiles of one batch inside the caller's transaction: gives out revisions, keeps the extents.
class TileWriter {
 public:
  TileWriter(Database& database, std::uint64_t revision) : database_(database), revision_(revision) {}

  [[nodiscard]] Result<void> write(const TileWrite& tile);
  // Stores the revision and the extents; call once, after the last write.
  [[nodiscard]] Result<void> finish();

  [[nodiscard]] std::uint64_t revision() const { return revision_; }
  [[nodiscard]] const std::vector<geo::TileKey>& changed() const { return changed_; }

 private:
  struct Extent {
    std::int64_t min_x = INT64_MAX, min_y = INT64_MAX, max_x = INT64_MIN, max_y = INT64_MIN;
    std::int64_t tiles = 0, bytes = 0;
    bool shrinks = false;
  };
  struct Row {
    std::int64_t id = 0;
    bool exists = false;
    LayerSet layers = 0;
  };
  [[nodiscard]] Result<Row> find(int space, const geo::TileKey& key);
  [[nodiscard]] Result<void> dropOtherTops(const geo::TileKey& key);
  [[nodiscard]] Result<bool> put(const Row& row, int space, const geo::TileKey& key,
                                 const EncodedLayer& layer, std::uint64_t revision);
  void count(int space, const geo::TileKey& key, int layer, std::int64_t tiles, std::int64_t bytes);

  Database& database_;
  std::uint64_t revision_;
  std::vector<geo::TileKey> changed_;
  std::map<std::pair<int, int>, Extent> extents_;  // by layer (0: any) and zoom
};

}  // namespace overfly::tiling::detail
