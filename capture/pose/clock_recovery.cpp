#include "capture/pose/clock_recovery.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace overfly::capture {
namespace {

constexpr std::size_t kMaxReadings = 256;
constexpr std::int64_t kSecond = 1'000'000'000;
constexpr std::int64_t kPairsHold_ns = 30 * kSecond;
constexpr double kLate_ns = 2e9;
constexpr std::int64_t kPatience_ns = 5 * kSecond;
constexpr std::int64_t kFar = 4'000'000'000'000'000'000;  // so that no difference of two times overflows

bool usable(std::int64_t time_ns) { return time_ns > -kFar && time_ns < kFar; }

std::int64_t saturatedDifference(std::int64_t a, std::int64_t b) {
  std::int64_t result = 0;
  if (!__builtin_sub_overflow(a, b, &result)) return result;
  return a < b ? -kFar : kFar;
}

double secondsBetween(std::int64_t from, std::int64_t to) {
  return static_cast<double>(saturatedDifference(to, from)) * 1e-9;
}

double square(double x) { return x * x; }

}  // namespace

void ClockRecovery::addPair(std::int64_t device_ns, std::int64_t boottime_ns, std::int64_t sigma_ns) {
  if (!usable(device_ns) || !usable(boottime_ns)) return;
  ++counts_.readings;
  last_pair_ns_ = boottime_ns;
  add(pairs_, {device_ns, boottime_ns - device_ns, std::max<std::int64_t>(sigma_ns, 1)}, 3);
}

void ClockRecovery::addArrival(std::int64_t device_ns, std::int64_t arrival_ns) {
  if (!usable(device_ns) || !usable(arrival_ns)) return;
  ++counts_.readings;
  last_arrival_ns_ = arrival_ns;
  add(arrivals_, {device_ns, arrival_ns - device_ns, options_.latency_sigma_ns}, 6);
}

void ClockRecovery::add(Track& track, const Reading& reading, std::size_t needed) {
  const auto agree = [this](double difference_ns, double sigma) {
    return std::abs(difference_ns) <= std::max(static_cast<double>(options_.gate_ns), 6 * sigma);
  };
  if (track.line) {
    const double off = static_cast<double>(saturatedDifference(reading.offset_ns, track.line->offset_ns)) -
                       predict(*track.line, reading.device_ns);
    const double sigma =
        std::hypot(sigmaAt(*track.line, reading.device_ns), static_cast<double>(reading.sigma_ns));
    if (!agree(off, sigma)) {
      if (!track.suspects.empty() && !agree(static_cast<double>(saturatedDifference(
                                                reading.offset_ns, track.suspects.front().offset_ns)),
                                            sigma)) {
        counts_.outliers += track.suspects.size();
        track.suspects.clear();
      }
      track.suspects.push_back(reading);
      if (track.suspects.size() < needed) return;
      // Late messages are a congested link for a while, before they are a clock that was put back.
      const bool late = !track.paired && off > 0 && off < kLate_ns;
      if (late &&
          std::abs(saturatedDifference(reading.device_ns, track.suspects.front().device_ns)) < kPatience_ns)
        return;
      // Arrivals are followed beside pairs, and the same jump is one.
      if (&track == &now()) ++counts_.jumps;
      track.readings = std::move(track.suspects);
      track.suspects.clear();
      track.line = fit(track);
      return;
    }
    counts_.outliers += track.suspects.size();
    track.suspects.clear();
  }
  // Of arrivals within one second the one that waited least stands for all.
  if (!track.paired && !track.readings.empty() &&
      track.readings.back().device_ns / kSecond == reading.device_ns / kSecond) {
    if (reading.offset_ns >= track.readings.back().offset_ns) return;
    track.readings.back() = reading;
  } else {
    track.readings.push_back(reading);
  }
  while (track.readings.size() > kMaxReadings ||
         saturatedDifference(reading.device_ns, track.readings.front().device_ns) > options_.window_ns) {
    track.readings.pop_front();
  }
  track.line = fit(track);
}

ClockRecovery::Line ClockRecovery::fit(const Track& track) const {
  const auto& readings = track.readings;
  Line line;
  // Around the best reading: differences stay small and exact.
  const auto best =
      std::min_element(readings.begin(), readings.end(),
                       [](const Reading& a, const Reading& b) { return a.sigma_ns < b.sigma_ns; });
  line.device_ns = readings.back().device_ns;
  line.newest_ns = line.device_ns;
  line.offset_ns = best->offset_ns;
  line.floor = static_cast<double>(best->sigma_ns);
  const double prior = 1 / square(options_.drift_sigma * 1e9);
  double a = 0, b = 0;  // ns, ns/s, relative to line.offset_ns
  for (int round = 0; round < 3; ++round) {
    double w = 0, wx = 0, wxx = prior, wy = 0, wxy = 0, spread = 0, count = 0;
    for (const Reading& reading : readings) {
      const double x = secondsBetween(line.device_ns, reading.device_ns);
      const double y = static_cast<double>(saturatedDifference(reading.offset_ns, line.offset_ns));
      const double sigma = static_cast<double>(reading.sigma_ns);
      double weight = 1 / square(sigma);
      if (round > 0) {
        const double size = std::abs(y - a - b * x) / sigma;
        spread += square(std::min(size, 3.0));
        ++count;
        if (size > 1.5) weight *= 1.5 / size;
      }
      w += weight;
      wx += weight * x;
      wxx += weight * x * x;
      wy += weight * y;
      wxy += weight * x * y;
    }
    const double determinant = w * wxx - wx * wx;
    a = (wxx * wy - wx * wxy) / determinant;
    b = (w * wxy - wx * wy) / determinant;
    const double scale = count > 2 ? std::max(1.0, spread / count) : 1;
    line.var_offset = scale * wxx / determinant;
    line.var_slope = scale * w / determinant;
    line.cov = -scale * wx / determinant;
  }
  const auto whole = static_cast<std::int64_t>(std::llround(std::clamp(a, -1e18, 1e18)));
  line.offset_ns += whole;
  line.slope = b;
  return line;
}

double ClockRecovery::predict(const Line& line, std::int64_t device_ns) {
  return line.slope * secondsBetween(line.device_ns, device_ns);
}

double ClockRecovery::sigmaAt(const Line& line, std::int64_t device_ns) const {
  const double x = secondsBetween(line.device_ns, device_ns);
  const double beyond = std::max(0.0, secondsBetween(line.newest_ns, device_ns));
  const double variance = line.var_offset + 2 * x * line.cov + x * x * line.var_slope + square(line.floor) +
                          square(options_.drift_change_sigma * 1e9 * beyond);
  return std::sqrt(std::max(variance, 0.0));
}

const ClockRecovery::Track& ClockRecovery::now() const {
  const bool fresh = last_arrival_ns_ - last_pair_ns_ < kPairsHold_ns;
  return pairs_.line && (fresh || !arrivals_.line) ? pairs_ : arrivals_;
}

std::optional<ClockRecovery::Time> ClockRecovery::boottimeFrom(std::int64_t device_ns) const {
  const auto& line = now().line;
  if (!line || !usable(device_ns)) return std::nullopt;
  const double change = std::clamp(predict(*line, device_ns), -1e18, 1e18);
  std::int64_t ns = 0;
  if (__builtin_add_overflow(device_ns, line->offset_ns, &ns) ||
      __builtin_add_overflow(ns, static_cast<std::int64_t>(std::llround(change)), &ns)) {
    return std::nullopt;
  }
  const double sigma = std::min(sigmaAt(*line, device_ns), 1e18);
  return Time{ns, static_cast<std::int64_t>(std::llround(sigma))};
}

std::optional<std::int64_t> ClockRecovery::deviceFrom(std::int64_t boottime_ns) const {
  const auto& line = now().line;
  if (!line || !usable(boottime_ns)) return std::nullopt;
  const std::int64_t first = saturatedDifference(boottime_ns, line->offset_ns);
  const double change = std::clamp(predict(*line, first), -1e18, 1e18);
  return saturatedDifference(first, static_cast<std::int64_t>(std::llround(change)));
}

double ClockRecovery::drift() const {
  const auto& line = now().line;
  return line ? -line->slope * 1e-9 : 0;
}

std::int64_t unwrap32(std::uint32_t value, std::int64_t near) {
  const auto difference = static_cast<std::int32_t>(value - static_cast<std::uint32_t>(near));
  return near + difference;
}

}  // namespace overfly::capture
