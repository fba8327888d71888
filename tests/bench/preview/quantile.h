#pragma once
#include <algorithm>
#include <array>
#include <utility>
#include <vector>

namespace overfly::bench {

// What a distribution is told by.
inline constexpr std::array<std::pair<const char*, double>, 4> kShares{
    {{"50", 0.5}, {"95", 0.95}, {"99", 0.99}, {"100", 1.0}}};

// The value that `share` of them do not exceed; sorts them. None: 0.
inline double quantile(std::vector<double>& values, double share) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0
                        : values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

}  // namespace overfly::bench
