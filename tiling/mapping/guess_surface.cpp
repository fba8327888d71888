#include "tiling/mapping/guess_surface.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace overfly::tiling {
namespace {

// The weighted mean of four heights without those above the lowest and a step; NaN of none.
float lowMean(const std::array<float, 4>& heights, const std::array<float, 4>& weights, float step_m) {
  float lowest = INFINITY;
  for (std::size_t k = 0; k < 4; ++k)
    if (weights[k] > 0 && heights[k] < lowest) lowest = heights[k];
  float sum = 0, total = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    if (!(weights[k] > 0 && heights[k] <= lowest + step_m)) continue;
    sum += weights[k] * heights[k];
    total += weights[k];
  }
  return total > 0 ? sum / total : NAN;
}

}  // namespace

std::vector<float> guessSurface(std::span<const float> height, int side, double step_m, double fallback_m) {
  std::vector<float> result(height.begin(), height.end());
  if (side <= 1) {
    for (float& h : result)
      if (std::isnan(h)) h = static_cast<float>(fallback_m);
    return result;
  }
  const auto n = static_cast<std::size_t>(side);
  const int half = (side + 1) / 2;
  const auto m = static_cast<std::size_t>(half);
  const auto step = static_cast<float>(step_m);
  if (std::none_of(result.begin(), result.end(), [](float h) { return std::isnan(h); })) return result;
  std::vector<float> coarse(m * m);
  for (std::size_t y = 0; y < m; ++y)
    for (std::size_t x = 0; x < m; ++x) {
      const std::size_t left = 2 * x, top = 2 * y, right = std::min(left + 1, n - 1),
                        bottom = std::min(top + 1, n - 1);
      coarse[y * m + x] = lowMean({result[top * n + left], result[top * n + right], result[bottom * n + left],
                                   result[bottom * n + right]},
                                  {1, 1, 1, 1}, step);
    }
  coarse = guessSurface(coarse, half, 2 * step_m, fallback_m);
  for (std::size_t y = 0; y < n; ++y)
    for (std::size_t x = 0; x < n; ++x) {
      float& h = result[y * n + x];
      if (!std::isnan(h)) continue;
      const double px = std::clamp((static_cast<double>(x) - 0.5) / 2, 0.0, half - 1.0);
      const double py = std::clamp((static_cast<double>(y) - 0.5) / 2, 0.0, half - 1.0);
      const auto ix = std::min(static_cast<std::size_t>(px), m - 1),
                 iy = std::min(static_cast<std::size_t>(py), m - 1);
      const std::size_t jx = std::min(ix + 1, m - 1), jy = std::min(iy + 1, m - 1);
      const auto fx = static_cast<float>(px - static_cast<double>(ix)),
                 fy = static_cast<float>(py - static_cast<double>(iy));
      h = lowMean({coarse[iy * m + ix], coarse[iy * m + jx], coarse[jy * m + ix], coarse[jy * m + jx]},
                  {(1 - fy) * (1 - fx), (1 - fy) * fx, fy * (1 - fx), fy * fx}, 2 * step);
    }
  return result;
}

}  // namespace overfly::tiling
