#include "tiling/sweep/path_aggregation.h"

#include <algorithm>
#include <array>

namespace overfly::tiling {

std::vector<PlaneVolume::Choice> PlaneVolume::aggregate(float step_penalty, float jump_penalty) const {
  const auto planes = static_cast<std::size_t>(planes_);
  const auto side = static_cast<std::size_t>(side_);
  std::vector<float> total(score_.size(), 0.0f);
  std::vector<float> row(side * planes), previous_row(side * planes);
  constexpr std::array<std::array<int, 2>, 8> kDirections{
      {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, -1}, {1, -1}, {-1, 1}}};

  for (const auto& [dx, dy] : kDirections) {
    // Rows in the order in which the predecessor (x - dx, y - dy) comes first.
    for (int step_y = 0; step_y < side_; ++step_y) {
      const int y = dy >= 0 ? step_y : side_ - 1 - step_y;
      for (int step_x = 0; step_x < side_; ++step_x) {
        const int x = dx >= 0 ? step_x : side_ - 1 - step_x;
        const int px = x - dx, py = y - dy;
        const std::size_t here = (static_cast<std::size_t>(y) * side + static_cast<std::size_t>(x)) * planes;
        float* out = &row[static_cast<std::size_t>(x) * planes];
        if (px < 0 || px >= side_ || py < 0 || py >= side_) {
          std::copy_n(&score_[here], planes, out);
        } else {
          const float* before = dy == 0 ? &row[static_cast<std::size_t>(px) * planes]
                                        : &previous_row[static_cast<std::size_t>(px) * planes];
          const float best_before = *std::max_element(before, before + planes);
          for (std::size_t p = 0; p < planes; ++p) {
            float reach = std::max(before[p], best_before - jump_penalty);
            if (p > 0) reach = std::max(reach, before[p - 1] - step_penalty);
            if (p + 1 < planes) reach = std::max(reach, before[p + 1] - step_penalty);
            out[p] = score_[here + p] + reach - best_before;
          }
        }
        for (std::size_t p = 0; p < planes; ++p) total[here + p] += out[p];
      }
      std::swap(row, previous_row);
    }
  }

  std::vector<Choice> choice(side * side);
  for (std::size_t i = 0; i < choice.size(); ++i) {
    const float* sum = &total[i * planes];
    const float* own = &score_[i * planes];
    const auto best = static_cast<std::size_t>(std::max_element(sum, sum + planes) - sum);
    float offset = 0, drop = 0;
    if (best > 0 && best + 1 < planes) {
      const float curvature = sum[best - 1] - 2 * sum[best] + sum[best + 1];
      if (curvature < -1e-9f)
        offset = std::clamp(0.5f * (sum[best - 1] - sum[best + 1]) / curvature, -0.5f, 0.5f);
      drop = own[best] - std::max(own[best - 1], own[best + 1]);
    }
    choice[i] = {static_cast<float>(best) + offset, own[best], drop};
  }
  return choice;
}

}  // namespace overfly::tiling
