#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "daemon/link/bundle.h"
#include "daemon/pull/want_list.h"
#include "tiling/store/map_store.h"

namespace overfly::pull {

// What a drone's map is (its /tiles.json): enough to make one of the same kind.
struct RemoteMap {
  std::string id;       // of the drone's map
  std::string mission;  // its name in the link's URLs
  std::uint64_t revision = 0;
  tiling::MapMeta meta;  // name, lattice, datum, tile size, base zoom, elevation step
};

// Everything here becomes visible and durable together, or not at all.
struct MirrorBatch {
  std::vector<link::TileRecord> records;
  std::vector<tiling::FrameRecord> frames;
  std::optional<std::string> cursor;  // of /changes, that all records up to it are in the mirror for
};

// Where a mirror is kept. Thread rule: one thread; readers of the file go their own ways.
class Mirror {
 public:
  virtual ~Mirror() = default;
  // Io: nothing was written; the same batch may be tried again.
  [[nodiscard]] virtual Result<void> commit(const MirrorBatch& batch) = 0;
  // The drone's revision of a layer that is here; 0: not here.
  [[nodiscard]] virtual std::uint64_t revisionOf(const LayerKey& what) const = 0;
  [[nodiscard]] virtual std::string cursor() const = 0;       // "0" in a new mirror
  [[nodiscard]] virtual tiling::LayerSet layers() const = 0;  // that it can keep
  [[nodiscard]] virtual std::filesystem::path path() const = 0;
};

// A map file of the project's own, FOLDER/MISSION.overfly: every layer, byte for byte as at the drone, and so
// a map for `overfly serve` and `overfly export` at any moment. BadInput: a file of that name is there and
// mirrors another map.
[[nodiscard]] Result<std::unique_ptr<Mirror>> openMapMirror(const std::filesystem::path& folder,
                                                            const RemoteMap& remote);
// An MBTiles file (version 1.3) of the colour layer, tile by tile the drone's own files. BadInput: the file
// is there and mirrors another map, or the map's lattice has no XYZ tiles.
[[nodiscard]] Result<std::unique_ptr<Mirror>> openMbTilesMirror(const std::filesystem::path& file,
                                                                const RemoteMap& remote);

}  // namespace overfly::pull
