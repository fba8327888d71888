#include "daemon/overflyd/latency.h"

#include <algorithm>
#include <vector>

namespace overfly::daemon {

void Latency::add(double seconds) {
  ++frames_;
  last_.push_back(seconds);
  if (last_.size() > kKept) last_.pop_front();
}

Latency::Summary Latency::summary() const {
  Summary summary;
  summary.frames = frames_;
  if (last_.empty()) return summary;
  summary.last = last_.back();
  std::vector<double> sorted(last_.begin(), last_.end());
  std::sort(sorted.begin(), sorted.end());
  const auto at = [&](double share) {
    return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1) + 0.5)];
  };
  summary.median = at(0.5);
  summary.p95 = at(0.95);
  return summary;
}

}  // namespace overfly::daemon
