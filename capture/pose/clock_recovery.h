#pragma once
#include <cstdint>
#include <deque>
#include <optional>

namespace overfly::capture {

struct ClockRecoveryOptions {
  // Readings older than this, counted from the newest, are forgotten. Raising it averages longer and follows
  // a changing drift (temperature) later.
  std::int64_t window_ns = 60'000'000'000;
  double drift_sigma = 50e-6;        // 1 sigma of a crystal against ours, before anything is measured
  double drift_change_sigma = 2e-6;  // and of its change after the newest reading
  // One-way readings: nobody can tell the smallest delay of a link from an offset; 1 sigma of what is left.
  std::int64_t latency_sigma_ns = 3'000'000;
  // A reading that is off by more than this and by more than 6 sigma is not believed at first.
  std::int64_t gate_ns = 20'000'000;
};

struct ClockCounts {
  std::uint64_t readings = 0;
  std::uint64_t outliers = 0;  // not believed, and the next ones agreed with the clock as it was
  std::uint64_t jumps = 0;     // the device's clock was set or began anew
};

// A device's clock against ours (CLOCK_BOOTTIME), from readings of both: offset and drift by a weighted
// straight line over a window (Huber's weights; a prior keeps the drift of a short window small). Two kinds
// of readings: pairs, both clocks at one instant (TIMESYNC, an edge), and arrivals, a device's stamp and when
// it came here: late by an unknown delay, of which the smallest in each second counts. Pairs win where they
// are younger than 30 s. A single wild reading is dropped; three pairs (or six arrivals) in a row that agree
// with each other and not with the clock are a jump, and the clock begins anew with them; arrivals that are
// late by less than 2 s must go on for 5 s, because a congested link looks the same. All times are integers:
// a double holds nanoseconds since 1970 only to 256 ns. Value type, thread-bound.
class ClockRecovery {
 public:
  explicit ClockRecovery(const ClockRecoveryOptions& options = {}) : options_(options) {}

  // Both clocks at one instant; 1 sigma of the pairing.
  void addPair(std::int64_t device_ns, std::int64_t boottime_ns, std::int64_t sigma_ns);
  // A message stamped by the device and when it came.
  void addArrival(std::int64_t device_ns, std::int64_t arrival_ns);

  struct Time {
    std::int64_t ns = 0;
    std::int64_t sigma_ns = 0;
  };
  // Our time when the device's clock shows that; nullopt before the first reading.
  [[nodiscard]] std::optional<Time> boottimeFrom(std::int64_t device_ns) const;
  // What the device's clock shows at our time.
  [[nodiscard]] std::optional<std::int64_t> deviceFrom(std::int64_t boottime_ns) const;
  // Of the device's clock against ours, 1: fast by one second a second.
  [[nodiscard]] double drift() const;
  [[nodiscard]] const ClockCounts& counts() const { return counts_; }
  // From pairs (true) or arrivals.
  [[nodiscard]] bool paired() const { return now().paired; }

 private:
  struct Reading {
    std::int64_t device_ns = 0;
    std::int64_t offset_ns = 0;  // ours minus the device's
    std::int64_t sigma_ns = 0;
  };
  // offset = offset_ns + slope (device - device_ns), seconds and nanoseconds; variances of both and
  // covariance.
  struct Line {
    std::int64_t device_ns = 0, newest_ns = 0;
    std::int64_t offset_ns = 0;
    double slope = 0;  // ns per s
    double var_offset = 0, var_slope = 0, cov = 0;
    double floor = 0;  // what does not average out, ns
  };
  struct Track {
    std::deque<Reading> readings;
    std::deque<Reading> suspects;
    std::optional<Line> line;
    bool paired = false;
  };

  void add(Track& track, const Reading& reading, std::size_t needed);
  [[nodiscard]] Line fit(const Track& track) const;
  [[nodiscard]] static double predict(const Line& line, std::int64_t device_ns);
  [[nodiscard]] double sigmaAt(const Line& line, std::int64_t device_ns) const;
  [[nodiscard]] const Track& now() const;

  ClockRecoveryOptions options_;
  Track pairs_{{}, {}, {}, true}, arrivals_;
  std::int64_t last_pair_ns_ = 0, last_arrival_ns_ = 0;  // ours
  ClockCounts counts_;
};

// The 64-bit value nearest to `near` whose lower 32 bits are `value`: what a counter of milliseconds that
// begins again every 49.7 days stands for.
[[nodiscard]] std::int64_t unwrap32(std::uint32_t value, std::int64_t near);

}  // namespace overfly::capture
