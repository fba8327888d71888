#include "daemon/governor/governor.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace overfly::daemon {
namespace {

constexpr double kNever = -std::numeric_limits<double>::infinity();
// A device's speed is learned by an exponential average over about this many cells.
constexpr double kLearning = 1.0 / 12;
// The other work comes in bursts (a batch's colours after its sweeps): averaged over about this many cells.
constexpr double kForgetting = 1.0 / 40;
// Shares of the latency and of the time that a point may use: to be gone down to, and (less, hence
// hysteresis) up to.
constexpr double kFitUse = 0.85, kRiseUse = 0.7, kRiseLatency = 0.4;
// The first cells compile shaders and fill caches: nothing is concluded before so many cells, or this share
// of the latency spent on them.
constexpr int kFirstCells = 8;
constexpr double kFirstShare = 0.5;
constexpr double kLeastLeft = 0.05;  // of the time, whatever frames and heat take

}  // namespace

GovernorOptions governorOptions(const config::Quality& quality) {
  GovernorOptions options;
  switch (quality.mode) {
    case config::QualityMode::Realtime:
      options.latency_s = 3;
      break;
    case config::QualityMode::Balanced:
      options.latency_s = 15;
      break;
    case config::QualityMode::Best:
      options.latency_s = std::numeric_limits<double>::infinity();
      break;
  }
  if (quality.latency_s > 0) options.latency_s = quality.latency_s;
  if (quality.gpu_share > 0) options.share = quality.gpu_share;
  if (quality.ms_per_tile > 0) options.s_per_cell = quality.ms_per_tile / 1000;
  return options;
}

Governor::Governor(const OperatingTable& table, const GovernorOptions& options, double device_s)
    : table_(&table),
      options_(options),
      point_(table.size() - 1),
      device_s_(device_s),
      known_before_(device_s > 0),
      raised_s_(kNever),
      room_since_s_(kNever),
      patience_s_(options.patience_s) {}

double Governor::secondsPerCell(std::size_t point) const {
  const double other_s = recent_cells_ > 0 ? other_s_ / recent_cells_ : 0;
  return device_s_ * (*table_)[point].relative_time + other_s;
}

void Governor::swept(std::size_t point, double seconds) {
  if (!(seconds > 0) || !std::isfinite(seconds)) return;
  const double at_best = seconds / (*table_)[point].relative_time;
  if (!known()) {
    ++first_cells_;
    first_cells_s_ += seconds;
  }
  // A mean of the first cells but for the very first, unless an earlier run knew better.
  const double weight =
      known_before_ ? kLearning : std::clamp(1.0 / std::max(first_cells_ - 1, 1), kLearning, 1.0);
  device_s_ += weight * (at_best - device_s_);
  other_s_ *= 1 - kForgetting;
  recent_cells_ = (1 - kForgetting) * recent_cells_ + 1;
}

double Governor::speed(const Load& load) const {
  return options_.share * std::max(load.headroom, kLeastLeft);
}

double Governor::drain(std::size_t point, const Load& load) const {
  return load.waiting_cells * secondsPerCell(point) / (speed(load) * std::max(1 - frames_share_, kLeastLeft));
}

double Governor::utilisation(std::size_t point, const Load& load) const {
  return rate_ * secondsPerCell(point) / speed(load) + frames_share_;
}

bool Governor::affordable(std::size_t point) const {
  return point == 0 || secondsPerCell(point) <= options_.s_per_cell;
}

bool Governor::known() const {
  return first_cells_ >= kFirstCells || first_cells_s_ > kFirstShare * options_.latency_s;
}

std::size_t Governor::decide(const Load& load) {
  if (!begun_) {
    begun_ = true;
    last_s_ = changed_s_ = load.now_s;
    last_due_ = load.cells_due;
    frames_s_ = 0;  // with them the map's ground was found and shaders were compiled
  }
  if (const double elapsed = load.now_s - last_s_; elapsed > 0) {
    const double now_rate =
        static_cast<double>(load.cells_due - std::min(last_due_, load.cells_due)) / elapsed;
    const double weight = 1 - std::exp(-elapsed / options_.averaging_s);
    rate_ += weight * (now_rate - rate_);
    frames_share_ += weight * (std::min(std::exchange(frames_s_, 0.0) / elapsed, 1.0) - frames_share_);
    if (load.landed) frames_share_ = 0;
    last_s_ = load.now_s;
    last_due_ = load.cells_due;
  }
  const auto change = [&](std::size_t to) {
    if (to == point_) return;
    point_ = to;
    changed_s_ = load.now_s;
    room_since_s_ = kNever;
    ++changes_;
  };
  const auto keepsUp = [&](std::size_t point, double use, double latency) {
    return affordable(point) && utilisation(point, load) <= use &&
           drain(point, load) <= latency * options_.latency_s;
  };
  const bool dear = !affordable(point_);
  const bool behind = known() && drain(point_, load) > options_.latency_s;
  in_one_go_ = load.landed && affordable(best()) && (in_one_go_ || drain(best(), load) < options_.landing_s);
  if (in_one_go_) {
    change(best());
  } else if (point_ > 0 && (dear || (behind && load.now_s - changed_s_ >= options_.settle_s))) {
    std::size_t lower = point_ - 1;
    while (lower > 0 && !keepsUp(lower, kFitUse, 1.0)) --lower;
    if (load.now_s - raised_s_ < options_.relapse_s)
      patience_s_ = std::min(2 * patience_s_, options_.patience_most_s);
    change(lower);
  } else if (point_ + 1 < table_->size() && keepsUp(point_ + 1, kRiseUse, kRiseLatency)) {
    if (room_since_s_ == kNever) room_since_s_ = load.now_s;
    if (load.now_s - room_since_s_ >= patience_s_) {
      if (load.now_s - raised_s_ > 2 * options_.relapse_s) patience_s_ = options_.patience_s;
      change(point_ + 1);
      raised_s_ = load.now_s;
    }
  } else {
    room_since_s_ = kNever;
  }
  backlog_s_ = drain(point_, load);
  return point_;
}

}  // namespace overfly::daemon
