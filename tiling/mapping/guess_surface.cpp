#include "tiling/mapping/guess_surface.h"

#include <algorithm>
#include <cmath>

namespace overfly::tiling {

std::vector<float> guessSurface(std::span<const float> height, int side, double fallback_m) {
  std::vector<float> result(height.begin(), height.end());
  if (side <= 1) {
    for (float& h : result)
      if (std::isnan(h)) h = static_cast<float>(fallback_m);
    return result;
  }
  const auto n = static_cast<std::size_t>(side);
  const int half = (side + 1) / 2;
  const auto m = static_cast<std::size_t>(half);
  if (std::none_of(result.begin(), result.end(), [](float h) { return std::isnan(h); })) return result;
  std::vector<float> coarse(m * m, 0.0f), count(m * m, 0.0f);
  for (std::size_t y = 0; y < n; ++y)
    for (std::size_t x = 0; x < n; ++x)
      if (const float h = result[y * n + x]; !std::isnan(h)) {
        coarse[(y / 2) * m + x / 2] += h;
        count[(y / 2) * m + x / 2] += 1;
      }
  for (std::size_t i = 0; i < coarse.size(); ++i) coarse[i] = count[i] > 0 ? coarse[i] / count[i] : NAN;
  coarse = guessSurface(coarse, half, fallback_m);
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
      h = (1 - fy) * ((1 - fx) * coarse[iy * m + ix] + fx * coarse[iy * m + jx]) +
          fy * ((1 - fx) * coarse[jy * m + ix] + fx * coarse[jy * m + jx]);
    }
  return result;
}

}  // namespace overfly::tiling
