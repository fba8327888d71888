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
  // What the views of a cell tell is the sum of their gains (SelectedView::gain): about 1 for the first that
  // sees all of it, 1/2 for the second from a good angle, 1/3 for the third.
  double first_knowledge = 1.5;  // worth the first sweep; 1.5: three views that see most of the cell
  double growth = 0.8;    // worth another one, as a share of what the last sweep knew: higher saves work
  double max_wait_s = 5;  // a cell that was never swept, and that no new frame sees for so long, has to
                          // make do with what it has
  double settle_s = 40;   // the same for a swept one, however little is new
  double spare_s = 12;    // the same when there is nothing else to do
  double max_updates_per_s = 0;  // sweeps of level-0 cells; 0: no limit
  int batch_tiles = 16;          // level-0 cells before their parents are made
  int max_tries = 3;             // of a cell that fails; it is dropped then, until a new frame marks it
  double retry_s = 2;
  double interest_half_life_s = 10;  // of a client's request for a tile
  double recency_half_life_s = 10;   // of a new frame
};

struct TileJob {
  // Sweep: heights from the frames. Finish: heights blended with the neighbours' and coloured, from a cell
  // whose sweep is done. The others: from stored children; for Top the key is TopTile::key().
  enum class Kind { Sweep, Finish, FromChildren, Top };
  Kind kind = Kind::Sweep;
  geo::TileKey key;
  int tries = 0;  // that failed before
};

// Which cell of level 0 is swept when, and what is made after it (thesis, 3.2.5, 3.3.3). The thesis updates a
// tile after a number of new frames or a time. A frame's neighbours see nearly the same ground, so a cell is
// seen by a dozen frames and would be swept as often; here it is swept first when its views tell enough, then
// again when they tell much more, and at last when no new frame has come for a while: about twice in all.
//
// Due cells are handed out in batches in the order of interest (what is looked at; every ten seconds that a
// cell has been worth a sweep count like a class of it), then expected gain of the
// recent frames, then age; after the last frame in the order of place. First their sweeps, then their
// finishing (so that a cell is blended with the new heights of those swept beside it), then their parents,
// level by level, each once per batch, and the top tile last. A cell whose neighbour has new heights or whose
// colours are to be made again is finished anew when nothing else is due and it has been so for settle_s:
// mostly it is swept before that. The thesis makes parents only when no level-0 tile is left; frames never
// stop in flight, so batches are bounded here.
//
// Pure logic: no clock (every call gets the time, nanoseconds of any steady clock), no disk, no GPU.
// Deterministic. Memory grows with the map by some 100 bytes per cell.
// Thread rule: not thread-safe; one owner, or a lock around it.
class Scheduler {
 public:
  Scheduler(int base_zoom, const SchedulerOptions& options);
  void setOptions(const SchedulerOptions& options) { options_ = options; }

  // The area A has grown (it never shrinks here): adds the parents of new levels and the new top tile to the
  // work. Give it the area of what is stored at start, and a frame's footprint before its cells are marked:
  // what lies outside has no parent.
  void cover(const PlaneBox& area);
  [[nodiscard]] const Layout& layout() const { return layout_; }

  // A new frame sees the cell; `knowledge` is what its views, the new one among them, tell now.
  void mark(const geo::TileKey& key, double knowledge, std::int64_t now_ns);
  // A pose among its frames was corrected, or the tile is damaged: due at once.
  void markDue(const geo::TileKey& key, std::int64_t now_ns);
  // Its last sweep was a quick one: due, but nobody waits for it.
  void markImprovable(const geo::TileKey& key, std::int64_t now_ns);
  // Its heights stand; its colours, or its neighbours' heights, do not.
  void markStale(const geo::TileKey& key, std::int64_t now_ns);
  // Stored by an earlier run, from views that tell `knowledge`.
  void assumeMade(const geo::TileKey& key, double knowledge);
  // A tile above level 0 is to be made again from its children (after a restart, or when it is damaged).
  void markParent(const geo::TileKey& key);
  // A tile was made without a job of this scheduler: what is made from it is due. An area that covers it is
  // known.
  void markParentOf(const geo::TileKey& key);
  // True: no more frames will come, so nothing is waited for.
  void setLanded(bool landed) { landed_ = landed; }

  // The preview's clip centre in plane coordinates, and the radius within which its interest halves; nullopt:
  // nobody looks.
  void setClipCentre(const std::optional<Eigen::Vector2d>& centre, double radius = 0);
  // A link client asked for a tile of any zoom (x unwrapped near the map): what lies beneath comes sooner.
  void requested(const geo::TileKey& key, std::int64_t now_ns);

  // The next piece of work; nullopt when nothing is due, or what is due waits for running jobs. Every job is
  // answered by done() or failed() once.
  [[nodiscard]] std::optional<TileJob> next(std::int64_t now_ns);
  // `changed`: what it made differs from before. A sweep's neighbours are then stale; a tile's parent is due
  // in this batch.
  void done(const TileJob& job, bool changed, std::int64_t now_ns);
  void failed(const TileJob& job, std::int64_t now_ns);

  // When next() may have something that it has not now; nullopt: not before something else happens.
  [[nodiscard]] std::optional<std::int64_t> nextDue(std::int64_t now_ns) const;

  // How long the longest waiting of the cells that are worth a sweep has been so; 0: there is none. What the
  // machine is behind by: cells that wait for more views do not count.
  [[nodiscard]] std::int64_t overdue(std::int64_t now_ns) const;

  // Cells that are worth a sweep and wait for it, and how many have become so since the start.
  [[nodiscard]] std::size_t worthTiles() const;
  [[nodiscard]] std::uint64_t worthSoFar() const { return worth_so_far_; }
  // Frames that its last sweep did not have see the cell.
  [[nodiscard]] bool waits(const geo::TileKey& key) const { return waiting_.contains(key); }

  // Cells whose frames or surroundings have changed since they were made.
  [[nodiscard]] std::size_t waitingTiles() const { return waiting_.size() + stale_.size(); }
  [[nodiscard]] std::size_t waitingParents() const { return parents_.size(); }
  [[nodiscard]] std::size_t running() const { return running_.size() + running_parents_.size(); }
  // Nothing is left to do but to wait for frames.
  [[nodiscard]] bool idle() const {
    return waitingTiles() + waitingParents() + running() + sweeps_.size() + finishes_.size() == 0;
  }
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }
  // What has to survive a restart, ascending: level-0 cells (mark them due then), and parents.
  [[nodiscard]] std::vector<geo::TileKey> unfinishedTiles() const;
  [[nodiscard]] std::vector<geo::TileKey> unfinishedParents() const;

 private:
  struct Waiting {
    double knowledge = 0;
    std::int64_t worth_ns = -1;      // since when it is worth a sweep; -1: it is not yet
    std::int64_t last_ns = 0;        // of the last mark
    std::int64_t not_before_ns = 0;  // after a failure
    std::uint64_t order = 0;
    int tries = 0;
    bool improvement = false;  // only that: no frame is new
  };
  struct Stale {
    std::int64_t since_ns = 0;  // the last time
    int tries = 0;
    std::int64_t not_before_ns = 0;
  };
  using ParentEntry = std::pair<int, geo::TileKey>;  // level; the top tile is at level L-1

  // `spare`: there is nothing else to do.
  [[nodiscard]] std::int64_t dueTime(const geo::TileKey& key, const Waiting& waiting, bool spare) const;
  [[nodiscard]] std::int64_t dueTime(const Stale& stale) const;
  [[nodiscard]] bool isWorth(const geo::TileKey& key, const Waiting& waiting) const;
  [[nodiscard]] double gainOf(const geo::TileKey& key, const Waiting& waiting) const;
  [[nodiscard]] int interest(const geo::TileKey& key, std::int64_t now_ns) const;
  void refill(std::int64_t now_ns);
  void chooseBatch(std::int64_t now_ns);
  void chooseSweeps(std::size_t most, bool spare, std::int64_t now_ns);
  void chooseFinishes(std::size_t most, std::int64_t now_ns);
  [[nodiscard]] std::optional<TileJob> nextParent();

  SchedulerOptions options_;
  Layout layout_;
  std::map<geo::TileKey, Waiting> waiting_;  // seen by frames that the last sweep did not have
  std::map<geo::TileKey, Stale> stale_;      // to be finished again
  std::map<geo::TileKey, double> made_;      // what was known at the last sweep
  std::map<geo::TileKey, std::pair<TileJob, Waiting>> running_;
  std::set<ParentEntry> parents_;
  std::set<ParentEntry> running_parents_;
  std::map<ParentEntry, int> parent_tries_;
  std::vector<geo::TileKey> sweeps_;    // of the batch, still to hand out, best last
  std::vector<geo::TileKey> finishes_;  // likewise
  std::set<geo::TileKey> batch_;        // cells of the batch
  bool landed_ = false;
  std::uint64_t next_order_ = 0;
  std::uint64_t dropped_ = 0;
  std::uint64_t worth_so_far_ = 0;
  double tokens_ = 0;  // updates that the limit allows now
  std::optional<std::int64_t> tokens_ns_;
  std::optional<Eigen::Vector2d> clip_centre_;
  double clip_radius_ = 0;
  std::map<geo::TileKey, std::int64_t> requests_;  // time of the last one
};

}  // namespace overfly::tiling
