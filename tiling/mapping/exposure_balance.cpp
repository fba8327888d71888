#include "tiling/mapping/exposure_balance.h"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>

namespace overfly::tiling {

namespace {

constexpr int kWidth_px = 128;  // at most, of what is kept of each frame of a flight: 12 kB
constexpr int kSteps = 32;      // compared along a row

}  // namespace

void ExposureBalance::add(Thumbnail thumbnail, double ground_height_m) {
  remove(thumbnail.frame_id);
  while (thumbnail.camera.width > kWidth_px) thumbnail = thumbnail.halved();
  for (const auto& [id, other] : thumbnails_) {
    const double reach =
        3 * (geo::geodeticFromEcef(thumbnail.pose.position_in_ecef).height_m - ground_height_m);
    if ((other.pose.position_in_ecef - thumbnail.pose.position_in_ecef).norm() > reach) continue;
    // In a fixed direction, so that the order of arrival does not matter.
    const Thumbnail& a = id < thumbnail.frame_id ? other : thumbnail;
    const Thumbnail& b = id < thumbnail.frame_id ? thumbnail : other;
    const LumaPairs pairs = pairsOnGround(a, b, ground_height_m, std::max(1, a.camera.width / kSteps));
    if (pairs.a.size() < 40) continue;
    std::vector<double> logs;
    for (std::size_t i = 0; i < pairs.a.size(); ++i)
      if (pairs.a[i] > 0.04f && pairs.b[i] > 0.04f && pairs.a[i] < 0.96f && pairs.b[i] < 0.96f)
        logs.push_back(std::log(static_cast<double>(pairs.b[i]) / static_cast<double>(pairs.a[i])));
    if (logs.size() < 40) continue;
    const auto middle = logs.begin() + static_cast<std::ptrdiff_t>(logs.size() / 2);
    std::nth_element(logs.begin(), middle, logs.end());
    ratios_.push_back({a.frame_id, b.frame_id, *middle,
                       static_cast<double>(pairs.a.size()) / static_cast<double>(pairs.tried)});
  }
  const std::uint64_t id = thumbnail.frame_id;
  thumbnails_.insert_or_assign(id, std::move(thumbnail));
}

void ExposureBalance::remove(std::uint64_t frame_id) {
  if (thumbnails_.erase(frame_id) == 0) return;
  std::erase_if(ratios_, [&](const Ratio& r) { return r.a == frame_id || r.b == frame_id; });
}

std::map<std::uint64_t, float> ExposureBalance::solve() const {
  constexpr double kPrior = 0.01;
  std::map<std::uint64_t, int> column;
  for (const auto& [id, thumbnail] : thumbnails_) column.emplace(id, static_cast<int>(column.size()));
  const auto n = static_cast<Eigen::Index>(column.size());
  std::vector<Eigen::Triplet<double>> triplets;
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  for (Eigen::Index i = 0; i < n; ++i)
    triplets.emplace_back(static_cast<int>(i), static_cast<int>(i), kPrior);
  std::vector<Ratio> ratios = ratios_;
  std::sort(ratios.begin(), ratios.end(),
            [](const Ratio& x, const Ratio& y) { return std::pair(x.a, x.b) < std::pair(y.a, y.b); });
  for (const Ratio& ratio : ratios) {
    // gain_a * luma_a = gain_b * luma_b  <=>  log gain_b - log gain_a = -log_ratio
    const int a = column.at(ratio.a), b = column.at(ratio.b);
    triplets.emplace_back(a, a, ratio.weight);
    triplets.emplace_back(b, b, ratio.weight);
    triplets.emplace_back(a, b, -ratio.weight);
    triplets.emplace_back(b, a, -ratio.weight);
    right[a] += ratio.weight * ratio.log_ratio;
    right[b] -= ratio.weight * ratio.log_ratio;
  }
  Eigen::SparseMatrix<double> normal(n, n);
  normal.setFromTriplets(triplets.begin(), triplets.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(normal);
  const Eigen::VectorXd log_gain = solver.solve(right);
  std::map<std::uint64_t, float> gains;
  for (const auto& [id, i] : column)
    gains[id] = static_cast<float>(std::exp(std::clamp(log_gain[i], -1.0, 1.0)));
  return gains;
}

}  // namespace overfly::tiling
