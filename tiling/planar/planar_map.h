#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <span>
#include <vector>

#include "capture/frame.h"
#include "config/error.h"
#include "tiling/clipmap/scheduler.h"
#include "tiling/index/frame_index.h"
#include "tiling/planar/planar_image.h"
#include "tiling/planar/planar_projector.h"
#include "tiling/planar/spare.h"
#include "tiling/planar/workers.h"
#include "tiling/rectify/pinned_lru.h"
#include "tiling/store/store_writer.h"
#include "tiling/store/tile_codec.h"

namespace overfly::tiling {

struct PlanarOptions {
  double height_m = 0;  // of the plane, ellipsoidal
  double anchor_px = 0.5;
  int threads = 2;                      // that decode, project and encode, the calling one among them
  int ahead = 2;                        // frames that are decoded before their turn
  std::size_t image_bytes = 64u << 20;  // decoded frames kept; a frame that has left is loaded again
  std::size_t tile_bytes = 256u << 20;  // tiles kept: three quarters of it as they are drawn, to be drawn on;
                                        // the rest as what their parents need of them
  int batch_updates = 400;  // tile updates before tiles are coded, parents made and all is committed; higher
                            // saves codings, parents and syncs, and shows the map later. Less when the tiles
                            // that wait would fill their share of tile_bytes
  // A tile with a hole is soon coded again: the fast method costs 5 % more bytes.
  EncodeOptions encoding{.color = {.webp_method = 0}, .elevation = {}};
};

// Counts and CPU-seconds, summed over threads; commit_s is the wall time of the writing thread's part that
// the caller had to wait for.
struct PlanarStatistics {
  std::uint64_t frames = 0, images_loaded = 0;
  std::uint64_t tiles = 0;      // updates of level-0 tiles: drawn on with texels of a new frame
  std::uint64_t unchanged = 0;  // tiles under a new frame that shows nothing better
  std::uint64_t coded = 0;      // level-0 tiles coded and committed: several updates in a batch are one
  std::uint64_t parents = 0;
  std::uint64_t commits = 0, bytes = 0;  // transactions; coded layers
  double decode_s = 0, plan_s = 0, project_s = 0, encode_s = 0, parents_s = 0, commit_s = 0;
};

// The Flexible Clipmap of the GRAPP paper: frames are laid onto a plane, level-0 tiles are drawn on as frames
// arrive, and every batch (of some frames) codes the tiles that have changed, makes their parents level by
// level, each once, and commits all of it to the map's store as one transaction. As in the paper, where tiles
// are updated in memory and written beside it. For flat ground, and for a first look before heights are
// known; the sweep's true orthophoto (tiling/mapping) replaces it where the ground is not flat.
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
  // A tile of level 0 as it is drawn: exact, whatever the store's coding loses.
  struct Drawn {
    Tile tile;
    PlanarPlan::Marks marks;
    bool waits = false;  // changed since it was coded
    std::list<geo::TileKey>::iterator place;
  };
  // What the parent of a stored tile needs of it.
  struct Half {
    std::shared_ptr<const Tile> tile;
    bool waits = false;  // its tile is not on its way to the store yet
    std::list<geo::TileKey>::iterator place;
  };
  struct Coded {
    TileWrite write;
    Tile half;
  };
  PlanarMap(MapStore store, MapReader reader, geo::TileLattice lattice, const PlanarOptions& options);

  [[nodiscard]] Result<PlanarImagePtr> decode(const capture::Frame& frame, double gsd_m);
  [[nodiscard]] Result<void> takeNext();
  [[nodiscard]] Result<void> drawTiles(std::uint64_t id, std::span<const geo::TileKey> keys);
  [[nodiscard]] Result<void> drawImages(std::uint64_t newest, std::span<const PlanarPlan> plans,
                                        std::span<const PlanarPlan::Changes> changes,
                                        std::span<Drawn* const> tiles, std::vector<std::uint8_t>& changed);
  [[nodiscard]] Drawn& drawn(const PlanarPlan& plan);
  [[nodiscard]] Result<Coded> code(Tile& tile, double& encode_s, double& parents_s);
  [[nodiscard]] Result<void> finishBatch();
  [[nodiscard]] Result<void> codeTiles();
  [[nodiscard]] Result<void> makeParents(std::span<const TileJob> jobs);
  [[nodiscard]] Result<std::shared_ptr<const Tile>> half(const geo::TileKey& key);
  std::shared_ptr<const Tile> keepHalf(Tile&& half, bool waits);
  [[nodiscard]] Result<void> submit();
  [[nodiscard]] std::size_t drawnBytes() const;  // of one tile
  [[nodiscard]] std::size_t drawnShare() const { return options_.tile_bytes / 4 * 3; }
  [[nodiscard]] std::int64_t now_ns() { return ++clock_; }

  StoreWriter writer_;
  MapReader reader_;
  geo::TileLattice lattice_;
  PlanarOptions options_;
  int tile_size_ = 0, base_zoom_ = 0;
  double texel_m_ = 0;  // at the first frame
  FrameIndex index_;
  Scheduler scheduler_;  // of the parents; tiles of level 0 are made as frames come
  // Memory of images, of tiles that are drawn on, of joined halves, and of halves; before what gives it back.
  Spare<std::vector<std::uint8_t>> spare_pixels_;
  Spare<Tile> spare_tiles_, spare_joined_, spare_halves_;
  std::deque<Arriving> arriving_;
  std::map<std::uint64_t, Source> sources_;
  PinnedLru<PlanarImage> images_;
  // By key, and in the order of use, the oldest first to go.
  std::map<geo::TileKey, Drawn> drawn_;
  std::list<geo::TileKey> drawn_order_;
  std::vector<geo::TileKey> waiting_;
  std::map<geo::TileKey, Half> halves_;
  std::list<geo::TileKey> halves_order_;
  std::set<geo::TileKey> gone_;  // left halves_ while the store may not have had them yet
  int updates_ = 0;              // since the last batch
  Batch batch_;
  std::int64_t clock_ = 0;
  std::mutex statistics_mutex_;
  PlanarStatistics statistics_;
  Workers workers_;  // last: what it runs uses everything above
};

}  // namespace overfly::tiling
