#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

namespace overfly::capture {

struct PulseMatcherOptions {
  // What a frame's own stamp is expected to lag behind its pulse. Where pulses and frames both come as
  // regularly as a clock, only this can tell which pulse is whose: the lag is taken that is nearest to it.
  std::int64_t expected_lag_ns = 0;
  std::int64_t max_lag_ns = 1'000'000'000;  // of either sign
  // How well pulses and stamps must agree at least, however quiet both are; raising it lets more jitter
  // through and tells pulses apart less well.
  std::int64_t least_tolerance_ns = 500'000;
};

struct PulseCounts {
  std::uint64_t pulses = 0;
  std::uint64_t matched = 0;
  std::uint64_t frames_without = 0;  // no pulse where one should be, or two of which either may be it
  std::uint64_t spurious = 0;        // pulses that no frame has taken and none can any more
  std::uint64_t locks = 0;           // times that the lag was found (anew)
};

// Which exposure pulse belongs to which frame. Frames carry a stamp of their own that lags behind the
// exposure by an unknown, slowly changing time and wanders by some jitter. The lag is found by trying those
// that any pulse and any recent frame would mean and taking the one under which most frames have a pulse;
// after that each frame takes the pulse that lies where its own stamp says, if there is exactly one. Nothing
// is counted along, so a missed pulse, a spurious one or a dropped frame concerns itself alone and never
// shifts what comes later. Pulses are taken in order: a frame never gets an earlier one than its predecessor.
// Thread-bound.
class PulseMatcher {
 public:
  explicit PulseMatcher(const PulseMatcherOptions& options = {}) : options_(options) {}

  // Our clock, in order.
  void addPulse(std::int64_t time_ns, std::int64_t sigma_ns = 1000);

  struct Match {
    std::int64_t pulse_ns = 0, sigma_ns = 0;
  };
  // Frames in order. nullopt: no pulse is surely this frame's, or the lag is not known yet.
  [[nodiscard]] std::optional<Match> match(std::int64_t stamp_ns);

  // A frame's stamp minus its pulse, as far as it is known, and how much it wanders (1 sigma).
  struct Lag {
    std::int64_t ns = 0, sigma_ns = 0;
    bool ambiguous = false;  // another lag would do as well: see expected_lag_ns
  };
  [[nodiscard]] std::optional<Lag> lag() const { return lag_; }
  // The newest pulse that came; 0: none.
  [[nodiscard]] std::int64_t newestPulse() const { return pulses_.empty() ? 0 : pulses_.back().time_ns; }
  [[nodiscard]] const PulseCounts& counts() const { return counts_; }

 private:
  struct Pulse {
    std::int64_t time_ns = 0, sigma_ns = 0;
    bool taken = false;
  };
  struct Fit {
    std::int64_t lag_ns = 0;
    double misfit = 0;           // the smaller the better
    std::int64_t spread_ns = 0;  // median of what is left
  };
  void findLag();
  [[nodiscard]] Fit fit(std::int64_t lag_ns, double scale_ns) const;
  [[nodiscard]] std::int64_t nearest(std::int64_t time_ns) const;  // signed distance to the nearest pulse
  [[nodiscard]] std::int64_t interval() const;                     // median between pulses
  [[nodiscard]] std::int64_t tolerance() const;
  void learn(std::int64_t residual_ns);

  PulseMatcherOptions options_;
  std::deque<Pulse> pulses_;
  std::deque<std::int64_t> stamps_;  // of recent frames
  std::deque<std::int64_t> lags_;    // of recent matches
  std::optional<Lag> lag_;
  std::int64_t last_taken_ns_ = 0;
  std::size_t misses_ = 0;  // in a row
  PulseCounts counts_;
};

}  // namespace overfly::capture
