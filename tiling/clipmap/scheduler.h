#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "capture/geo/tile_lattice.h"
#include "tiling/clipmap/layout.h"

namespace overfly::tiling {

struct SchedulerOptions {
  int min_new_frames = 2;        // a tile is due with so many new frames: higher saves work, shows later ...
  double max_wait_s = 5;         // ... or when its oldest new frame has waited so long
  double max_updates_per_s = 0;  // of level-0 tiles; 0: no limit
  int batch_tiles = 16;          // level-0 tiles before their parents are made
  int max_tries = 3;             // of a tile that fails; it is dropped then, until a new frame marks it
  double retry_s = 2;
  double interest_half_life_s = 10;  // of a client's request for a tile
  double recency_half_life_s = 10;   // of a new frame
};

struct TileJob {
  enum class Kind { FromFrames, FromChildren, Top };
  Kind kind = Kind::FromFrames;
  geo::TileKey key;    // for Top: TopTile::key()
  int new_frames = 0;  // FromFrames: since the last update
  int tries = 0;       // that failed before
};

// Which tile is made next (thesis, 3.2.5, 3.3.3). Level-0 tiles that new frames can improve wait until enough
// frames or time have come together; a batch of them is handed out in the order of interest (what is looked
// at), then expected gain of the recent frames, then age; then their parents, level by level, each once per
// batch, and the top tile last. The thesis makes parents only when no level-0 tile is left; frames never stop
// in flight, so batches are bounded here.
//
// Pure logic: no clock (every call gets the time, nanoseconds of any steady clock), no disk, no GPU.
// Deterministic. Memory grows with the tiles that wait, not with the map.
// Thread rule: not thread-safe; one owner, or a lock around it.
class Scheduler {
 public:
  Scheduler(int base_zoom, const SchedulerOptions& options);
  void setOptions(const SchedulerOptions& options) { options_ = options; }

  // The area A has grown (it never shrinks here): adds the parents of new levels and the new top tile to the
  // work. Give it the area of what is stored at start, and a frame's footprint before its tiles are marked:
  // what lies outside has no parent.
  void cover(const PlaneBox& area);
  [[nodiscard]] const Layout& layout() const { return layout_; }

  // A new frame can improve a level-0 tile by so much (improvableTiles).
  void mark(const geo::TileKey& key, double gain, std::int64_t now_ns);
  // A pose in the tile's frame set was corrected, or the tile is damaged: due at once.
  void markDue(const geo::TileKey& key, std::int64_t now_ns);
  // A tile above level 0 is to be made again from its children (after a restart, or when it is damaged).
  void markParent(const geo::TileKey& key);

  // The preview's clip centre in plane coordinates, and the radius within which its interest halves; nullopt:
  // nobody looks.
  void setClipCentre(const std::optional<Eigen::Vector2d>& centre, double radius = 0);
  // A link client asked for a tile of any zoom (x unwrapped near the map): what lies beneath comes sooner.
  void requested(const geo::TileKey& key, std::int64_t now_ns);

  // The next tile to make; nullopt when nothing is due, or what is due waits for running jobs. Every job is
  // answered by done() or failed() once.
  [[nodiscard]] std::optional<TileJob> next(std::int64_t now_ns);
  // `changed`: what is stored differs from before (then the parent is due in this batch).
  void done(const TileJob& job, bool changed, std::int64_t now_ns);
  void failed(const TileJob& job, std::int64_t now_ns);

  // When next() may have something that it has not now; nullopt: not before something else happens.
  [[nodiscard]] std::optional<std::int64_t> nextDue(std::int64_t now_ns) const;

  [[nodiscard]] std::size_t waitingTiles() const { return waiting_.size(); }
  [[nodiscard]] std::size_t waitingParents() const { return parents_.size(); }
  [[nodiscard]] std::size_t running() const { return running_.size() + running_parents_.size(); }
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }
  // What has to survive a restart, ascending: level-0 tiles (mark them due then), and parents.
  [[nodiscard]] std::vector<geo::TileKey> unfinishedTiles() const;
  [[nodiscard]] std::vector<geo::TileKey> unfinishedParents() const;

 private:
  struct Waiting {
    int new_frames = 0;
    bool due = false;                        // regardless of thresholds
    double gain = 0;                         // of the new frames
    std::int64_t first_ns = 0, last_ns = 0;  // first and last mark
    std::int64_t not_before_ns = 0;          // after a failure
    std::uint64_t order = 0;
    int tries = 0;
  };
  using ParentEntry = std::pair<int, geo::TileKey>;  // level; the top tile is at level L-1

  [[nodiscard]] bool isDue(const Waiting& waiting, std::int64_t now_ns) const;
  [[nodiscard]] std::int64_t dueTime(const Waiting& waiting) const;
  [[nodiscard]] int interest(const geo::TileKey& key, std::int64_t now_ns) const;
  void refill(std::int64_t now_ns);
  void chooseBatch(std::int64_t now_ns);
  void addParentOf(const geo::TileKey& key);
  [[nodiscard]] std::optional<TileJob> nextParent();

  SchedulerOptions options_;
  Layout layout_;
  std::map<geo::TileKey, Waiting> waiting_;
  std::map<geo::TileKey, TileJob> running_;
  std::set<ParentEntry> parents_;
  std::set<ParentEntry> running_parents_;
  std::map<ParentEntry, int> parent_tries_;
  std::vector<geo::TileKey> batch_;  // still to hand out, best last
  std::uint64_t next_order_ = 0;
  std::uint64_t dropped_ = 0;
  double tokens_ = 0;  // updates that the limit allows now
  std::optional<std::int64_t> tokens_ns_;
  std::optional<Eigen::Vector2d> clip_centre_;
  double clip_radius_ = 0;
  std::map<geo::TileKey, std::int64_t> requests_;  // time of the last one
};

}  // namespace overfly::tiling
