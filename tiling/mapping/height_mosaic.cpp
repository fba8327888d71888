#include "tiling/mapping/height_mosaic.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace overfly::tiling {
namespace {

// One axis: which of the three cells (-1, 0, 1) cover a mosaic coordinate, where in their field, how much.
struct AxisCover {
  int cell[2];
  int index[2];
  float share[2];
  int count;
};

std::vector<AxisCover> coverOf(int texels, int apron, int margin) {
  const int band = apron / 2;
  std::vector<AxisCover> covers;
  for (int i = -margin; i < texels + margin; ++i) {
    AxisCover cover{};
    for (int cell = -1; cell <= 1; ++cell) {
      const int local = i - cell * texels;                                // texel within that cell
      const double inside = std::min(local + 0.5, texels - local - 0.5);  // distance to its border
      const double share = std::clamp((inside + band) / (2.0 * band), 0.0, 1.0);
      if (share <= 0 || local + apron < 0 || local + apron >= texels + 2 * apron || cover.count == 2)
        continue;
      cover.cell[cover.count] = cell;
      cover.index[cover.count] = local + apron;
      cover.share[cover.count] = static_cast<float>(share);
      ++cover.count;
    }
    covers.push_back(cover);
  }
  return covers;
}

}  // namespace

HeightMosaic assembleHeights(const std::array<const HeightField*, 9>& fields, int margin, double step_m) {
  HeightMosaic mosaic;
  const HeightField& any = *fields[4];
  mosaic.texels = any.texels;
  mosaic.margin = margin;
  const auto side = static_cast<std::size_t>(mosaic.side());
  mosaic.height.assign(side * side, std::numeric_limits<float>::quiet_NaN());
  mosaic.confidence.assign(side * side, 0);
  mosaic.filled.assign(side * side, 0);
  const std::vector<AxisCover> covers = coverOf(any.texels, any.apron, margin);
  const auto field_side = static_cast<std::size_t>(any.side());
  for (std::size_t y = 0; y < side; ++y)
    for (std::size_t x = 0; x < side; ++x) {
      struct Candidate {
        float height, share;
        std::uint8_t confidence;
      } candidates[4];
      int count = 0;
      const AxisCover &cy = covers[y], &cx = covers[x];
      for (int j = 0; j < cy.count; ++j)
        for (int i = 0; i < cx.count; ++i) {
          const HeightField* field = fields[static_cast<std::size_t>((cy.cell[j] + 1) * 3 + cx.cell[i] + 1)];
          if (field == nullptr) continue;
          const std::size_t at =
              static_cast<std::size_t>(cy.index[j]) * field_side + static_cast<std::size_t>(cx.index[i]);
          if (std::isnan(field->height[at])) continue;
          candidates[count++] = {field->height[at], cy.share[j] * cx.share[i], field->confidence[at]};
        }
      if (count == 0) continue;
      const Candidate* main = &candidates[0];
      for (int k = 1; k < count; ++k)
        if (candidates[k].share * static_cast<float>(candidates[k].confidence) >
            main->share * static_cast<float>(main->confidence))
          main = &candidates[k];
      float sum = 0, total = 0, confidence = 0;
      for (int k = 0; k < count; ++k) {
        if (std::abs(candidates[k].height - main->height) > static_cast<float>(step_m)) continue;
        sum += candidates[k].share * (candidates[k].height - main->height);
        confidence += candidates[k].share * static_cast<float>(candidates[k].confidence);
        total += candidates[k].share;
      }
      mosaic.height[y * side + x] = main->height + sum / total;
      mosaic.confidence[y * side + x] = static_cast<std::uint8_t>(std::lround(confidence / total));
    }
  return mosaic;
}

}  // namespace overfly::tiling
