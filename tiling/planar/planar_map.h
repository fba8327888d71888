#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "capture/frame.h"
#include "config/error.h"
#include "tiling/clipmap/scheduler.h"
#include "tiling/index/frame_index.h"
#include "tiling/planar/planar_image.h"
#include "tiling/planar/planar_projector.h"
#include "tiling/rectify/pinned_lru.h"
#include "tiling/store/store_writer.h"
#include "tiling/store/tile_codec.h"

namespace overfly::tiling {

struct PlanarOptions {
  double height_m = 0;  // of the plane, ellipsoidal
  double anchor_px = 0.5;
  int threads = 2;                       // that decode, project and encode
  int ahead = 2;                         // frames that are decoded before their turn
  std::size_t image_bytes = 256u << 20;  // decoded frames kept; a frame that has left is loaded again
  std::size_t tile_bytes = 64u << 20;    // decoded tiles kept for their parents, beside one batch
  int batch_tiles = 128;  // updates of level 0 before their parents are made and all is committed; higher
                          // saves parents and syncs, and shows the map later. Less when tile_bytes is reached
  EncodeOptions encoding;
};

// Counts and CPU-seconds, summed over threads; commit_s is the wall time of the writing thread's part that
// the caller had to wait for.
struct PlanarStatistics {
  std::uint64_t frames = 0, images_loaded = 0, tiles = 0, unchanged = 0, parents = 0;
  std::uint64_t commits = 0, bytes = 0;  // transactions; coded layers
  double decode_s = 0, plan_s = 0, project_s = 0, encode_s = 0, parents_s = 0, commit_s = 0;
};

// The Flexible Clipmap of the GRAPP paper: frames are laid onto a plane, level-0 tiles are made again as
// frames arrive, their parents follow level by level, each once per batch, and every batch (of some frames)
// is one transaction of the map's store. For flat ground, and for a first look before heights are known; the
// sweep's true orthophoto (tiling/mapping) replaces it where the ground is not flat.
//
// A tile is a function of the frames that see it (PlanarPlan). A new frame that gives a tile no texel leaves
// it as it is. Memory is bounded by the options, whatever the map's size.
// Thread rule: one calling thread; it runs threads of its own within a call, and decodes ahead between calls.
class PlanarMap {
 public:
  using Loader = std::function<Result<capture::FramePtr>()>;

  // `store`: its meta says lattice, base zoom and tile size (a multiple of PlanarPlan::kBlock).
  [[nodiscard]] static Result<std::unique_ptr<PlanarMap>> create(MapStore store,
                                                                 const PlanarOptions& options);
  ~PlanarMap();

  // Takes a frame with pose. It is decoded beside the calling thread; its tiles are made when `ahead` further
  // frames have come, or by finish(). `load` fetches it again after it has left the cache. BadInput: no
  // usable pose or camera (the frame is passed over); Io: the disk refused.
  [[nodiscard]] Result<void> addFrame(std::uint64_t id, const capture::FramePtr& frame, Loader load);
  // Makes everything that is left and waits for the disk.
  [[nodiscard]] Result<void> finish();

  [[nodiscard]] const PlanarStatistics& statistics() const { return statistics_; }
  [[nodiscard]] const FrameIndex& index() const { return index_; }

 private:
  struct Arriving {
    std::uint64_t id;
    std::future<Result<PlanarImagePtr>> image;
  };
  struct Source {
    double gsd_m = 0;
    Loader load;
  };
  PlanarMap(MapStore store, MapReader reader, geo::TileLattice lattice, const PlanarOptions& options);

  [[nodiscard]] Result<PlanarImagePtr> decode(const capture::Frame& frame, double gsd_m);
  [[nodiscard]] Result<void> takeNext();
  [[nodiscard]] Result<void> finishBatch();
  [[nodiscard]] Result<void> makeTiles(std::uint64_t id, std::span<const geo::TileKey> keys);
  [[nodiscard]] Result<std::vector<std::vector<PlanarImagePtr>>> imagesOf(std::span<const PlanarPlan> plans);
  [[nodiscard]] Result<void> makeParents(std::span<const TileJob> jobs);
  [[nodiscard]] Result<std::shared_ptr<const Tile>> child(const geo::TileKey& key);
  [[nodiscard]] Result<void> submit();
  void keep(Tile&& tile);
  [[nodiscard]] std::int64_t now_ns() { return ++clock_; }

  StoreWriter writer_;
  MapReader reader_;
  geo::TileLattice lattice_;
  PlanarOptions options_;
  int tile_size_ = 0, base_zoom_ = 0;
  double texel_m_ = 0;  // at the first frame
  FrameIndex index_;
  Scheduler scheduler_;  // of the parents; tiles of level 0 are made as frames come
  std::deque<Arriving> arriving_;
  std::map<std::uint64_t, Source> sources_;
  PinnedLru<PlanarImage> images_;
  // Decoded tiles by key, the oldest first to go.
  std::map<geo::TileKey, std::shared_ptr<const Tile>> recent_;
  std::deque<geo::TileKey> recent_order_;
  std::size_t recent_bytes_ = 0, batch_bytes_ = 0;  // of all; of those made in this batch
  Batch batch_;                                     // of several frames
  std::int64_t clock_ = 0;
  std::mutex statistics_mutex_;
  PlanarStatistics statistics_;
};

}  // namespace overfly::tiling
