#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "render/preview/domain.h"
#include "render/preview/focus.h"

namespace overfly::preview {

struct ClipOptions {
  int active = 7;       // tiles across the active area of a level (K of the thesis)
  int margin = 1;       // tiles that the clip area has more on each side
  int max_slots = 400;  // tiles that GPU memory may hold, beside the top
};

// A rectangle of tiles of one level, counted from the domain's corner.
struct TileWindow {
  int x = 0, y = 0, width = 0, height = 0;
  [[nodiscard]] bool contains(int tx, int ty) const {
    return tx >= x && ty >= y && tx < x + width && ty < y + height;
  }
  friend bool operator==(const TileWindow&, const TileWindow&) = default;
};

// Which tiles of which level belong into GPU memory, and into which slot of it (thesis, 3.3.2): level l has
// nu(l) = k(l)^2 slots from Omega(l) on, and tile (x, y) of the lattice lies in slot
//
//   Omega(l) + (y mod k) k + (x mod k)                                                 (3.6)-(3.8)
//
// so that a tile keeps its slot while the centre moves. The lattice's own indices count, not the domain's: a
// map that grows keeps its tiles in place.
//
// Maps whose levels do not all fit have a floating stack: every level keeps a small area (3x3) as a bridge to
// the coarser ones, and the levels that the view calls for share the stack's places, level l in place l mod
// depth.
//
// Value type; knows no GPU.
class ClipLayout {
 public:
  ClipLayout(const Domain& domain, const ClipOptions& options);

  [[nodiscard]] int slots() const { return slots_; }
  [[nodiscard]] bool floating() const { return depth_ > 0; }
  // The active areas and clip areas around the focus's centres.
  void moveTo(const Focus& focus);
  [[nodiscard]] const TileWindow& active(int level) const {
    return levels_[static_cast<std::size_t>(level)].active;
  }
  [[nodiscard]] const TileWindow& clip(int level) const {
    return levels_[static_cast<std::size_t>(level)].clip;
  }
  [[nodiscard]] int slot(int level, const geo::TileKey& key) const;
  // Tile nearest to the level's centre.
  [[nodiscard]] Eigen::Vector2i centre(int level) const {
    return levels_[static_cast<std::size_t>(level)].centre;
  }

 private:
  struct Level {
    int bridge = 0;  // tiles across where the level is not in the stack (all of its own where not floating)
    int bridge_offset = 0;
    bool in_stack = false;
    TileWindow active, clip;
    Eigen::Vector2i centre{0, 0};
  };
  [[nodiscard]] int acrossOf(const Level& level) const {
    return level.in_stack ? options_.active : level.bridge;
  }

  Domain domain_;
  ClipOptions options_;
  std::vector<Level> levels_;
  int slots_ = 0;
  int depth_ = 0;  // places of the stack; 0: not floating
  int stack_offset_ = 0;
};

// Tiles of a window in concentric squares around a centre, innermost first; within a square those first that
// lie in the direction of movement, and will stay the longest (DVT, 3.3, figures 3 and 4).
[[nodiscard]] std::vector<Eigen::Vector2i> ringOrder(const TileWindow& window, const Eigen::Vector2i& centre,
                                                     const Eigen::Vector2d& motion);

}  // namespace overfly::preview
