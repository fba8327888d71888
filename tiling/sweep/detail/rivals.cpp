#include "tiling/sweep/detail/rivals.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace overfly::tiling::detail {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
// Below, the views agree no better than chance often does: such a height has no rival, and little confidence.
constexpr float kSeen = 0.35f;
// Bands beside the best height in which a rival is looked for, in planes; each is seven planes wide. A
// pattern that the third finest grid does not show repeats within about twelve texels of the second.
constexpr float kBands[] = {-18, -12, -6, 6, 12, 18};
constexpr int kLevels = 2;      // the finest grids on which bands are tried
constexpr int kSpacing = 32;    // texels between those tried first
constexpr float kApart = 2.5f;  // planes: nearer ones belong to the same peak

// Each value of the coarser grid, nearest; both with the same apron in their own texels.
std::vector<float> finer(const std::vector<float>& coarse, int texels, int apron) {
  const int from = texels + 2 * apron, to = 2 * texels + 2 * apron;
  std::vector<float> result(static_cast<std::size_t>(to) * static_cast<std::size_t>(to));
  for (int y = 0; y < to; ++y)
    for (int x = 0; x < to; ++x)
      result[static_cast<std::size_t>(y * to + x)] =
          coarse[static_cast<std::size_t>((y + apron) / 2 * from + (x + apron) / 2)];
  return result;
}

bool any(std::span<const std::uint8_t> mask) { return std::find(mask.begin(), mask.end(), 1) != mask.end(); }

}  // namespace

void Rivals::begin(int side, std::span<const Best> best, std::span<const float> rival_height,
                   std::span<const float> rival_share) {
  height_.assign(best.size(), kNaN);
  for (std::size_t i = 0; i < best.size(); ++i)
    if (best[i].score >= kSeen && rival_share[i] >= max_share_) height_[i] = rival_height[i];
  dropLines(side);
}

void Rivals::dropLines(int side) {
  cv::Mat mask(side, side, CV_8U);
  for (std::size_t i = 0; i < height_.size(); ++i) mask.data[i] = std::isnan(height_[i]) ? 0 : 1;
  cv::morphologyEx(mask, mask, cv::MORPH_OPEN, cv::Mat::ones(3, 3, CV_8U));
  for (std::size_t i = 0; i < height_.size(); ++i)
    if (mask.data[i] == 0) height_[i] = kNaN;
}

bool Rivals::isRival(std::size_t texel, std::span<const Best> best) const {
  return !std::isnan(height_[texel]) && agreement_[texel] >= max_share_ * best[texel].agreement();
}

Result<void> Rivals::look(SweepPasses& passes, const Pass& pass, std::span<Best> best,
                          std::span<const float> base, std::span<const std::uint8_t> mask,
                          std::uint64_t& samples) {
  auto found = passes.best(pass, base, 0, samples, mask);
  if (!found) return tl::unexpected(found.error());
  for (std::size_t i = 0; i < best.size(); ++i) {
    if (mask[i] == 0) continue;
    Best other = (*found)[i];
    if (std::max(other.score, best[i].score) < kSeen ||
        std::abs(other.height - best[i].height) < kApart * static_cast<float>(pass.plane_step_m))
      continue;
    if (other.score >= kSeen && other.agreement() > best[i].agreement()) std::swap(best[i], other);
    if (other.agreement() <= agreement_[i]) continue;
    agreement_[i] = other.agreement();
    height_[i] = other.height;
  }
  return {};
}

Result<void> Rivals::refine(SweepPasses& passes, const Pass& pass, std::span<Best> best,
                            std::uint64_t& samples) {
  height_ = finer(height_, pass.grid->texels >> (pass.level + 1), pass.grid->apron);
  agreement_.assign(best.size(), 0.0f);
  const int side = pass.side();
  const auto step = static_cast<float>(pass.plane_step_m);
  std::vector<float> base(best.size());
  std::vector<std::uint8_t> mask(best.size());
  for (std::size_t i = 0; i < best.size(); ++i) {
    mask[i] = std::isnan(height_[i]) ? 0 : 1;
    base[i] = mask[i] != 0 ? height_[i] : best[i].height;
    height_[i] = kNaN;
  }
  if (any(mask))
    if (auto ok = look(passes, pass, best, base, mask, samples); !ok) return ok;
  if (pass.level < kLevels) {
    const auto tryBands = [&]() -> Result<void> {
      std::vector<float> centre(best.size());
      for (std::size_t i = 0; i < best.size(); ++i) centre[i] = best[i].height;
      for (const float band : kBands) {
        for (std::size_t i = 0; i < best.size(); ++i) base[i] = centre[i] + band * step;
        if (auto ok = look(passes, pass, best, base, mask, samples); !ok) return ok;
      }
      return {};
    };
    std::fill(mask.begin(), mask.end(), std::uint8_t{0});
    for (int y = kSpacing / 4; y < side; y += kSpacing)
      for (int x = kSpacing / 4; x < side; x += kSpacing) mask[static_cast<std::size_t>(y * side + x)] = 1;
    std::vector<float> before(best.size());
    for (std::size_t i = 0; i < best.size(); ++i) before[i] = best[i].height;
    if (auto ok = tryBands(); !ok) return ok;
    cv::Mat around(side, side, CV_8U);
    for (std::size_t i = 0; i < best.size(); ++i)
      around.data[i] = mask[i] != 0 && (isRival(i, best) || best[i].height != before[i]) ? 1 : 0;
    cv::dilate(around, around, cv::Mat::ones(2 * kSpacing + 1, 2 * kSpacing + 1, CV_8U));
    for (std::size_t i = 0; i < best.size(); ++i) mask[i] = around.data[i] != 0 && mask[i] == 0 ? 1 : 0;
    if (any(mask))
      if (auto ok = tryBands(); !ok) return ok;
  }
  for (std::size_t i = 0; i < best.size(); ++i)
    if (!isRival(i, best)) height_[i] = kNaN;
  dropLines(side);
  return {};
}

std::vector<std::uint8_t> Rivals::texels() const {
  std::vector<std::uint8_t> mask(height_.size());
  for (std::size_t i = 0; i < mask.size(); ++i) mask[i] = std::isnan(height_[i]) ? 0 : 1;
  // What lies between such texels is of the same pattern.
  const int side = static_cast<int>(std::lround(std::sqrt(static_cast<double>(mask.size()))));
  const cv::Mat image(side, side, CV_8U, mask.data());
  cv::morphologyEx(image, image, cv::MORPH_CLOSE, cv::Mat::ones(9, 9, CV_8U));
  return mask;
}

}  // namespace overfly::tiling::detail
