#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "config/error.h"
#include "tiling/sweep/sweep.h"

namespace overfly::daemon {

// One way to make a tile, with what it was measured to cost and to give. Plain value.
struct OperatingPoint {
  std::string name;
  int images = 12;        // SweepOptions::max_views
  int window_radius = 3;  // texels
  int levels = 4;         // of the coarse-to-fine search
  int finest_level = 0;   // where the search ends
  int widenings = 2;      // of the band
  bool two_surfaces = true;
  double relative_time = 1;  // time of a cell's sweep, in that of the slowest point that was tried
  double nmad_gsd = 0;       // of heights against an independent reference
  double complete = 1;       // share of reference points with a height
  bool as_set = false;       // what the settings say

  // `base` (what the settings say) with this point's choices where they are the cheaper ones.
  [[nodiscard]] tiling::SweepOptions applied(tiling::SweepOptions base) const;
  // The one figure that points are ordered by: NMAD, and a GSD for each tenth of the points that get no
  // height, so that leaving texels empty does not pass for accuracy.
  [[nodiscard]] double error() const { return nmad_gsd + 10 * (1 - complete); }
};

// The front of accuracy against time, cheapest first: every further point takes longer and errs less.
// A drone in the air knows no truth, so the errors come from this table, which `overfly bench tradeoff
// --table` measures on flights with a reference; only the time is measured on the device. Immutable.
class OperatingTable {
 public:
  // Leaves out what is off the front (as slow as, or slower than, a point that errs no more). The point that
  // is what the settings say is always kept, as the last one, and slower ones go: reference points lie on
  // smooth ground and do not see all that it is dearer for (edges, small things). BadInput: no point, or one
  // that is not a number.
  [[nodiscard]] static Result<OperatingTable> make(std::vector<OperatingPoint> points);
  // {"points": [{"name": ..., "images": ..., ...}, ...]}. BadInput with what is wrong.
  [[nodiscard]] static Result<OperatingTable> parse(std::string_view json);

  [[nodiscard]] std::size_t size() const { return points_.size(); }
  [[nodiscard]] const OperatingPoint& operator[](std::size_t index) const { return points_.at(index); }
  [[nodiscard]] const std::vector<OperatingPoint>& points() const { return points_; }
  [[nodiscard]] std::string json() const;
  // What the program brings along: measured on the recorded and simulated flights (docs/accuracy.md).
  [[nodiscard]] static const OperatingTable& shipped();

 private:
  std::vector<OperatingPoint> points_;
};

}  // namespace overfly::daemon
