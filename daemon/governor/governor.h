#pragma once
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "config/settings.h"
#include "daemon/governor/operating_table.h"

namespace overfly::daemon {

// What the governor holds to. Seconds.
struct GovernorOptions {
  double latency_s = 10;  // from a frame to the tiles that it improves; infinite: accuracy at any delay
  double share = 1;       // of the GPU's time that mapping may take
  double s_per_cell = std::numeric_limits<double>::infinity();  // no point that takes longer on this device
  double settle_s = 2;    // after a change, before the next one downwards
  double patience_s = 8;  // how long there must be room before a step upwards; doubled after a relapse
  double patience_most_s = 120;
  double relapse_s = 60;    // a step down within this after a step up is a relapse
  double averaging_s = 20;  // time constant of the rate at which work arrives
  // After the last frame nobody waits for the next one: what can be swept at the most accurate point in so
  // long is not swept at a faster one first, to be swept, blended and coloured a second time.
  double landing_s = 60;
};
[[nodiscard]] GovernorOptions governorOptions(const config::Quality& quality);

// How much there is to do, at one moment.
struct Load {
  double now_s = 0;             // any monotonic clock
  double waiting_cells = 0;     // to be swept
  std::uint64_t cells_due = 0;  // that have become due since the start, swept or not
  double headroom = 1;  // 1: cool; below: the kernel reports throttling, this much of the speed is left
  bool landed = false;  // no more frames will come
};

// Which operating point to make the next cell at, so that the map keeps up with the flight at the least
// error. Errors come from the table, time from this device. It moves along the front only: when what waits
// would take longer than the aim, down at once to the best point that keeps up; up by one after a time of
// room for it, and ever more patiently where that has failed before, so that it does not swing. A cell made
// at a lower point is made a second time later, so a queue that only grows is no reason yet. Pure logic; not
// thread-safe.
class Governor {
 public:
  // `device_s`: seconds that a cell takes here at the most accurate point, from an earlier run or a
  // calibration; 0: not known yet, the first cells tell.
  Governor(const OperatingTable& table, const GovernorOptions& options, double device_s = 0);

  // A cell was swept at a point in this many seconds (of a cool device: times the headroom).
  void swept(std::size_t point, double seconds);
  // Other work that the cells bring with them, whatever the point: colours, parents.
  void alsoSpent(double seconds) { other_s_ += seconds; }
  // Taking frames in, which comes before all cells: it takes its share of the time.
  void tookFrames(double seconds) { frames_s_ += seconds; }
  // The point for the next cell: an index into the table.
  std::size_t decide(const Load& load);

  [[nodiscard]] std::size_t point() const { return point_; }
  [[nodiscard]] const OperatingPoint& operatingPoint() const { return table_->points()[point_]; }
  [[nodiscard]] const OperatingTable& table() const { return *table_; }
  // Of a cell at a point, with its share of the other work, as far as is known; 0 when nothing is.
  [[nodiscard]] double secondsPerCell(std::size_t point) const;
  // Of a sweep at the most accurate point, for the next run to begin with.
  [[nodiscard]] double deviceSeconds() const { return device_s_; }
  // The most accurate point.
  [[nodiscard]] std::size_t best() const { return table_->size() - 1; }
  // Until everything that waits is done at the present point.
  [[nodiscard]] double backlog() const { return backlog_s_; }
  [[nodiscard]] std::uint64_t changes() const { return changes_; }
  // What may change while the daemon runs.
  void setOptions(const GovernorOptions& options) { options_ = options; }

 private:
  [[nodiscard]] double speed(const Load& load) const;
  [[nodiscard]] double drain(std::size_t point, const Load& load) const;
  [[nodiscard]] double utilisation(std::size_t point, const Load& load) const;
  [[nodiscard]] bool affordable(std::size_t point) const;
  [[nodiscard]] bool known() const;

  const OperatingTable* table_;
  GovernorOptions options_;
  std::size_t point_;
  double device_s_;
  bool known_before_;
  double other_s_ = 0;  // spent since the start of what `recent_cells_` counts, older seconds counting less
  double recent_cells_ = 0;
  double frames_s_ = 0;       // since the last decision
  double frames_share_ = 0;   // of the time
  int first_cells_ = 0;       // counted up to those that tell the device's speed
  double first_cells_s_ = 0;  // what they took
  double rate_ = 0;           // cells that become due per second
  double last_s_ = 0, changed_s_ = 0, raised_s_, room_since_s_;
  double patience_s_;
  double backlog_s_ = 0;
  std::uint64_t last_due_ = 0, changes_ = 0;
  bool begun_ = false, in_one_go_ = false;
};

}  // namespace overfly::daemon
