#include "daemon/tradeoff/trial.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <limits>
#include <numeric>

namespace overfly::tradeoff {
namespace {

double processorMilliseconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

}  // namespace

Timing timingOf(std::vector<double> milliseconds) {
  if (milliseconds.empty()) return {};
  std::sort(milliseconds.begin(), milliseconds.end());
  const std::size_t n = milliseconds.size();
  const double median =
      n % 2 == 1 ? milliseconds[n / 2] : 0.5 * (milliseconds[n / 2 - 1] + milliseconds[n / 2]);
  return {median, milliseconds.front(), milliseconds.back(), static_cast<int>(n)};
}

Elapsed elapsedOf(const std::function<void()>& work) {
  const auto wall = std::chrono::steady_clock::now();
  const double processor = processorMilliseconds();
  work();
  return {processorMilliseconds() - processor,
          std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - wall).count()};
}

void markFront(std::vector<Trial>& trials) {
  std::vector<std::size_t> order(trials.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::pair(trials[a].processor.median_ms, trials[a].error) <
           std::pair(trials[b].processor.median_ms, trials[b].error);
  });
  double least = std::numeric_limits<double>::infinity();
  for (const std::size_t i : order) {
    trials[i].on_front = trials[i].error < least;
    if (trials[i].on_front) least = trials[i].error;
  }
}

}  // namespace overfly::tradeoff
