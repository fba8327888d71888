#include "capture/gpio/pulse_matcher.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace overfly::capture {
namespace {

constexpr std::size_t kStamps = 24;      // frames that the lag is found from
constexpr std::size_t kLeastStamps = 8;  // at least
// Log-likelihood by which a lag must win: one frame at the end whose pulse has not come is not enough.
constexpr double kMargin = 10;
constexpr std::size_t kPulses = 256;
constexpr std::size_t kLags = 31;
constexpr std::size_t kMissesToDoubt = 10;

std::int64_t median(std::vector<std::int64_t> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

void PulseMatcher::addPulse(std::int64_t time_ns, std::int64_t sigma_ns) {
  if (!pulses_.empty() && time_ns <= pulses_.back().time_ns) return;
  ++counts_.pulses;
  pulses_.push_back({time_ns, sigma_ns, false});
  while (pulses_.size() > kPulses) {
    if (!pulses_.front().taken) ++counts_.spurious;
    pulses_.pop_front();
  }
}

std::int64_t PulseMatcher::interval() const {
  std::vector<std::int64_t> gaps;
  for (std::size_t i = 1; i < pulses_.size(); ++i)
    gaps.push_back(pulses_[i].time_ns - pulses_[i - 1].time_ns);
  return gaps.empty() ? options_.max_lag_ns : median(std::move(gaps));
}

std::int64_t PulseMatcher::nearest(std::int64_t time_ns) const {
  const auto after = std::lower_bound(pulses_.begin(), pulses_.end(), time_ns,
                                      [](const Pulse& pulse, std::int64_t t) { return pulse.time_ns < t; });
  std::int64_t best = std::numeric_limits<std::int64_t>::max();
  if (after != pulses_.end()) best = after->time_ns - time_ns;
  if (after != pulses_.begin()) {
    const std::int64_t before = std::prev(after)->time_ns - time_ns;
    if (-before < best) best = before;
  }
  return best;
}

PulseMatcher::Fit PulseMatcher::fit(std::int64_t lag_ns, double scale_ns) const {
  Fit fit{lag_ns, 0, 0};
  // The maximum nearby, by reweighting.
  for (int round = 0; round < 4; ++round) {
    double weights = 0, shift = 0;
    for (const std::int64_t stamp : stamps_) {
      const auto off = static_cast<double>(nearest(stamp - fit.lag_ns));
      const double weight = 1 / (1 + off * off / (scale_ns * scale_ns));
      weights += weight;
      shift -= weight * off;
    }
    fit.lag_ns += static_cast<std::int64_t>(shift / weights);
  }
  std::vector<std::int64_t> sizes;
  for (const std::int64_t stamp : stamps_) {
    const std::int64_t off = std::abs(nearest(stamp - fit.lag_ns));
    sizes.push_back(off);
    fit.misfit += std::log1p(std::pow(static_cast<double>(off) / scale_ns, 2));
  }
  fit.spread_ns = median(std::move(sizes));
  return fit;
}

void PulseMatcher::findLag() {
  // Frames from before the first pulse say nothing, and would pull the lag to where later pulses are theirs.
  while (!stamps_.empty() && !pulses_.empty() &&
         stamps_.front() - options_.expected_lag_ns < pulses_.front().time_ns - interval() / 2)
    stamps_.pop_front();
  if (stamps_.size() < kLeastStamps || pulses_.size() < kLeastStamps) return;
  const std::int64_t apart = std::max(interval() / 4, options_.least_tolerance_ns);
  const double scale = static_cast<double>(options_.least_tolerance_ns) / 2;
  std::vector<Fit> fits;
  // A few frames stand for all: the right lag is among what they and every pulse would mean.
  for (std::size_t k = 0; k < stamps_.size(); k += stamps_.size() / 4) {
    for (const Pulse& pulse : pulses_) {
      const std::int64_t lag = stamps_[k] - pulse.time_ns;
      if (std::abs(lag) <= options_.max_lag_ns) fits.push_back(fit(lag, scale));
    }
  }
  if (fits.empty()) return;
  const auto better = [](const Fit& a, const Fit& b) { return a.misfit < b.misfit; };
  Fit best = *std::min_element(fits.begin(), fits.end(), better);
  // Stamps that wander more than was assumed: measured finer than they are, one lag would win by chance.
  if (const double wander = 1.4826 * static_cast<double>(best.spread_ns); wander > scale) {
    for (Fit& one : fits) one = fit(one.lag_ns, std::min(wander, static_cast<double>(interval()) / 8));
    best = *std::min_element(fits.begin(), fits.end(), better);
  }
  const Fit* chosen = &best;
  Lag lag;
  for (const Fit& other : fits) {
    if (other.misfit > best.misfit + kMargin || std::abs(other.lag_ns - best.lag_ns) <= apart) continue;
    lag.ambiguous = true;
    if (std::abs(other.lag_ns - options_.expected_lag_ns) <
        std::abs(chosen->lag_ns - options_.expected_lag_ns))
      chosen = &other;
  }
  if (2 * chosen->spread_ns > interval() / 2) return;  // no better than pulses at random
  lag.ns = chosen->lag_ns;
  lag.sigma_ns = static_cast<std::int64_t>(1.4826 * static_cast<double>(chosen->spread_ns));
  lags_.clear();
  lag_ = lag;
  misses_ = 0;
}

std::int64_t PulseMatcher::tolerance() const {
  return std::min(std::max(8 * lag_->sigma_ns, options_.least_tolerance_ns),
                  std::max(interval() * 2 / 5, options_.least_tolerance_ns));
}

void PulseMatcher::learn(std::int64_t lag_ns) {
  lags_.push_back(lag_ns);
  while (lags_.size() > kLags) lags_.pop_front();
  std::vector<std::int64_t> values(lags_.begin(), lags_.end());
  if (lags_.size() < kLeastStamps) return;  // as it was found
  lag_->ns = median(values);
  for (std::int64_t& value : values) value = std::abs(value - lag_->ns);
  lag_->sigma_ns = static_cast<std::int64_t>(1.4826 * static_cast<double>(median(std::move(values))));
}

std::optional<PulseMatcher::Match> PulseMatcher::match(std::int64_t stamp_ns) {
  stamps_.push_back(stamp_ns);
  while (stamps_.size() > kStamps) stamps_.pop_front();
  // While several lags would do, more frames may yet tell them apart.
  if (!lag_) {
    findLag();
    if (lag_ && lag_->ambiguous && stamps_.size() < kStamps) lag_.reset();
    if (lag_) ++counts_.locks;
  }
  const auto miss = [&]() -> std::optional<Match> {
    ++counts_.frames_without;
    // Pulses come, and none fits any more: the lag has changed (another mode of the camera).
    if (lag_ && ++misses_ >= kMissesToDoubt && newestPulse() > stamp_ns - lag_->ns - 3 * interval()) {
      lag_.reset();
      while (stamps_.size() > kMissesToDoubt) stamps_.pop_front();
    }
    return std::nullopt;
  };
  if (!lag_) return miss();
  const std::int64_t due = stamp_ns - lag_->ns, tolerance_ns = tolerance();
  Pulse* best = nullptr;
  std::int64_t best_off = 0, second_off = std::numeric_limits<std::int64_t>::max();
  for (Pulse& pulse : pulses_) {
    const std::int64_t off = std::abs(pulse.time_ns - due);
    if (off > tolerance_ns || pulse.time_ns <= last_taken_ns_) continue;
    if (best == nullptr || off < best_off) {
      if (best != nullptr) second_off = best_off;
      best = &pulse;
      best_off = off;
    } else {
      second_off = std::min(second_off, off);
    }
  }
  // Two pulses of which the stamp's jitter cannot tell the right one.
  const std::int64_t doubt = 4 * lag_->sigma_ns + options_.least_tolerance_ns / 10;
  if (best == nullptr || second_off - best_off < doubt) return miss();
  best->taken = true;
  last_taken_ns_ = best->time_ns;
  misses_ = 0;
  ++counts_.matched;
  learn(stamp_ns - best->time_ns);
  return Match{best->time_ns, best->sigma_ns};
}

}  // namespace overfly::capture
