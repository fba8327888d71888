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

std::vector<AxisCover> coverOf(int texels, int apron, int margin, int band) {
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

// The field on a grid twice as fine: heights bilinear among the known ones, confidence as it was. Where the
// texel that a finer one lies in has no height, it has none.
HeightField refined(const HeightField& coarse) {
  HeightField fine;
  fine.texels = 2 * coarse.texels;
  fine.apron = coarse.apron;
  fine.halvings = coarse.halvings - 1;
  const int side = fine.side(), coarse_side = coarse.side();
  const auto n = static_cast<std::size_t>(side), m = static_cast<std::size_t>(coarse_side);
  fine.height.assign(n * n, std::numeric_limits<float>::quiet_NaN());
  fine.confidence.assign(n * n, 0);
  struct Between {
    std::size_t nearest, other;  // of the coarse texels; 3/4 and 1/4 of the way
  };
  std::vector<Between> along(n);
  for (int i = 0; i < side; ++i) {
    const int at = i - fine.apron;
    const int nearest = (at >= 0 ? at / 2 : (at - 1) / 2) + fine.apron;
    const int other = std::clamp(nearest + ((at & 1) != 0 ? 1 : -1), 0, coarse_side - 1);
    along[static_cast<std::size_t>(i)] = {static_cast<std::size_t>(nearest), static_cast<std::size_t>(other)};
  }
  for (std::size_t y = 0; y < n; ++y)
    for (std::size_t x = 0; x < n; ++x) {
      const std::size_t own = along[y].nearest * m + along[x].nearest;
      if (std::isnan(coarse.height[own])) continue;
      float sum = 0, total = 0;
      const auto add = [&](std::size_t at, float share) {
        if (std::isnan(coarse.height[at])) return;
        sum += share * (coarse.height[at] - coarse.height[own]);
        total += share;
      };
      add(own, 0.5625f);
      add(along[y].nearest * m + along[x].other, 0.1875f);
      add(along[y].other * m + along[x].nearest, 0.1875f);
      add(along[y].other * m + along[x].other, 0.0625f);
      fine.height[y * n + x] = coarse.height[own] + sum / total;
      fine.confidence[y * n + x] = coarse.confidence[own];
    }
  return fine;
}

}  // namespace

HeightMosaic assembleHeights(const std::array<const HeightField*, 9>& swept, int margin, double step_m) {
  std::array<const HeightField*, 9> fields = swept;
  int halvings = fields[4]->halvings;
  for (const HeightField* field : fields)
    if (field != nullptr) halvings = std::min(halvings, field->halvings);
  std::array<HeightField, 9> finer;
  for (std::size_t i = 0; i < fields.size(); ++i)
    while (fields[i] != nullptr && fields[i]->halvings > halvings) {
      finer[i] = refined(*fields[i]);
      fields[i] = &finer[i];
    }
  HeightMosaic mosaic;
  const HeightField& any = *fields[4];
  mosaic.texels = any.texels;
  mosaic.margin = margin >> halvings;
  mosaic.halvings = halvings;
  const auto side = static_cast<std::size_t>(mosaic.side());
  mosaic.height.assign(side * side, std::numeric_limits<float>::quiet_NaN());
  mosaic.confidence.assign(side * side, 0);
  mosaic.filled.assign(side * side, 0);
  const std::vector<AxisCover> covers =
      coverOf(any.texels, any.apron, mosaic.margin, (any.apron / 2) >> halvings);
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
