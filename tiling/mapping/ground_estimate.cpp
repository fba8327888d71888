#include "tiling/mapping/ground_estimate.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace overfly::tiling {
namespace {

constexpr double kMinOverlap = 0.2;
constexpr double kMinCorrelation = 0.5;
constexpr double kLeastParallax = 0.5;  // thumbnail pixels

double correlation(const LumaPairs& pairs) {
  const auto n = static_cast<double>(pairs.a.size());
  double ma = 0, mb = 0;
  for (std::size_t i = 0; i < pairs.a.size(); ++i) {
    ma += static_cast<double>(pairs.a[i]) / n;
    mb += static_cast<double>(pairs.b[i]) / n;
  }
  double ab = 0, aa = 1e-9, bb = 1e-9;
  for (std::size_t i = 0; i < pairs.a.size(); ++i) {
    const double da = static_cast<double>(pairs.a[i]) - ma, db = static_cast<double>(pairs.b[i]) - mb;
    ab += da * db;
    aa += da * da;
    bb += db * db;
  }
  return ab / std::sqrt(aa * bb);
}

struct PairGround {
  double height_m, correlation;
};

std::optional<PairGround> groundOfPair(const Thumbnail& a, const Thumbnail& b) {
  const double baseline = (a.pose.position_in_ecef - b.pose.position_in_ecef).norm();
  const double camera = geo::geodeticFromEcef(a.pose.position_in_ecef).height_m;
  if (baseline < 0.05) return std::nullopt;
  // Depth = f * baseline / parallax; from a parallax of most of the image's width down to half a pixel.
  const double scale = a.camera.fx * baseline;
  PairGround best{0, -1};
  double best_parallax = 0;
  const auto probe = [&](double parallax, int stride) {
    const LumaPairs pairs = pairsOnGround(a, b, camera - scale / parallax, stride);
    if (static_cast<double>(pairs.a.size()) < kMinOverlap * static_cast<double>(pairs.tried)) return;
    const double c = correlation(pairs);
    if (c > best.correlation) {
      best = {camera - scale / parallax, c};
      best_parallax = parallax;
    }
  };
  for (double parallax = kLeastParallax; parallax < 0.9 * std::max(a.camera.width, a.camera.height);
       parallax += 0.75)
    probe(parallax, 3);
  // Pictures that do not move against each other although the camera did (a frozen camera, dirt on the lens)
  // say nothing of the ground.
  if (best.correlation < 0 || best_parallax == kLeastParallax) return std::nullopt;
  const double coarse = best_parallax;
  best.correlation = -1;
  for (double d = -1.0; d <= 1.0; d += 0.125)
    if (coarse + d > 0.25) probe(coarse + d, 2);
  if (best.correlation < kMinCorrelation) return std::nullopt;
  return best;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

Result<GroundEstimate> estimateGround(std::span<const Thumbnail> frames) {
  std::vector<double> heights, correlations, above;
  for (std::size_t i = 0; i + 1 < frames.size(); ++i)
    for (std::size_t j = i + 1; j < std::min(frames.size(), i + 3); ++j) {
      const auto pair = groundOfPair(frames[i], frames[j]);
      if (!pair) continue;
      heights.push_back(pair->height_m);
      correlations.push_back(pair->correlation);
      above.push_back(geo::geodeticFromEcef(frames[i].pose.position_in_ecef).height_m - pair->height_m);
    }
  if (heights.empty())
    return fail(ErrorCode::Unavailable,
                "no two of the first frames agree on where the ground is; give its height with --ground");
  const auto [lowest, highest] = std::minmax_element(heights.begin(), heights.end());
  GroundEstimate estimate;
  estimate.height_m = median(heights);
  estimate.lowest_m = *lowest;
  estimate.highest_m = *highest;
  estimate.camera_above_m = median(above);
  estimate.correlation = median(correlations);
  estimate.pairs = static_cast<int>(heights.size());
  return estimate;
}

}  // namespace overfly::tiling
