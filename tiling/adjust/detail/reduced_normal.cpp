#include "tiling/adjust/detail/reduced_normal.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <utility>

#include "tiling/adjust/bundle.h"

namespace overfly::tiling::adjust::detail {
namespace {

constexpr int kLeastMeasured = 3;         // measurements that a point of the surface needs
constexpr std::size_t kLeastPoints = 20;  // of the surface

}  // namespace

QuadraticHeights quadraticHeights(const std::vector<double*>& points, const std::vector<int>& measured) {
  QuadraticHeights out;
  std::vector<Eigen::Index> used;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (measured[i] < kLeastMeasured) continue;
    used.push_back(static_cast<Eigen::Index>(i));
    centre += Eigen::Vector2d(points[i][0], points[i][1]);
  }
  if (used.size() < kLeastPoints) return out;
  const auto n = static_cast<Eigen::Index>(used.size());
  centre /= static_cast<double>(n);
  Eigen::MatrixXd form(n, 6);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double* p = points[static_cast<std::size_t>(used[static_cast<std::size_t>(i)])];
    const Eigen::Vector2d u = (Eigen::Vector2d(p[0], p[1]) - centre) / DomeUncertainty::kUnit;
    form.row(i) << 1, u.x(), u.y(), u.x() * u.x(), u.x() * u.y(), u.y() * u.y();
  }
  const Eigen::MatrixXd plane = form.leftCols(3);
  const Eigen::MatrixXd bend =
      form.rightCols(3) - plane * plane.colPivHouseholderQr().solve(form.rightCols(3));
  out.spread = bend.transpose() * bend / static_cast<double>(n);
  // With the plane taken away from both, the coefficients are (B^T B)^-1 B^T z.
  const Eigen::MatrixXd sums = bend * (bend.transpose() * bend).inverse();
  out.weights = Eigen::MatrixX3d::Zero(static_cast<Eigen::Index>(points.size()), 3);
  for (Eigen::Index i = 0; i < n; ++i) out.weights.row(used[static_cast<std::size_t>(i)]) = sums.row(i);
  return out;
}

ReducedNormal::ReducedNormal(ceres::Problem& problem, const std::vector<double*>& kept,
                             const std::vector<double*>& points, const Eigen::MatrixX3d& height_weights,
                             int threads) {
  ceres::Problem::EvaluateOptions evaluate;
  evaluate.parameter_blocks = kept;
  evaluate.parameter_blocks.insert(evaluate.parameter_blocks.end(), points.begin(), points.end());
  evaluate.num_threads = threads;
  ceres::CRSMatrix jacobian;
  problem.Evaluate(evaluate, nullptr, nullptr, nullptr, &jacobian);
  int kept_size = 0;
  for (const double* block : kept) kept_size += problem.ParameterBlockTangentSize(block);
  build(jacobian, kept_size, static_cast<int>(points.size()), height_weights);
}

Eigen::MatrixXd ReducedNormal::inverseBlock(int first, int n) const {
  if (n == 0 || factor_.info() != Eigen::Success) return Eigen::MatrixXd::Zero(n, n);
  Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(size_, n);
  unit.block(first, 0, n, n).setIdentity();
  return factor_.solve(unit).middleRows(first, n);
}

Eigen::Matrix3d ReducedNormal::heightsCovariance() const {
  if (heights_from_kept_.rows() == 0 || factor_.info() != Eigen::Success) return Eigen::Matrix3d::Zero();
  return heights_from_kept_.transpose() * Eigen::MatrixXd(factor_.solve(heights_from_kept_)) + heights_own_;
}

// One pass over the rows, which come in residual blocks: a row's point columns are at most one triple.
void ReducedNormal::build(const ceres::CRSMatrix& j, int kept_size, int point_count,
                          const Eigen::MatrixX3d& weights) {
  size_ = kept_size;
  struct PointPart {
    Eigen::Matrix3d v = Eigen::Matrix3d::Zero();
    std::vector<std::pair<int, Eigen::Vector3d>> w;  // column, coupling
  };
  std::vector<PointPart> points(static_cast<std::size_t>(point_count));
  std::vector<Eigen::Triplet<double>> entries;
  for (int row = 0; row < j.num_rows; ++row) {
    const auto begin = static_cast<std::size_t>(j.rows[static_cast<std::size_t>(row)]);
    const auto end = static_cast<std::size_t>(j.rows[static_cast<std::size_t>(row) + 1]);
    Eigen::Vector3d p = Eigen::Vector3d::Zero();
    int point = -1;
    for (auto i = begin; i < end; ++i) {
      if (j.cols[i] < kept_size) continue;
      point = (j.cols[i] - kept_size) / 3;
      p[(j.cols[i] - kept_size) % 3] = j.values[i];
    }
    if (point >= 0) points[static_cast<std::size_t>(point)].v += p * p.transpose();
    for (auto a = begin; a < end; ++a) {
      if (j.cols[a] >= kept_size || j.values[a] == 0) continue;
      if (point >= 0) points[static_cast<std::size_t>(point)].w.emplace_back(j.cols[a], p * j.values[a]);
      for (auto b = begin; b < end; ++b)
        if (j.cols[b] <= j.cols[a]) entries.emplace_back(j.cols[a], j.cols[b], j.values[a] * j.values[b]);
    }
  }
  if (weights.rows() == point_count) heights_from_kept_ = Eigen::MatrixX3d::Zero(size_, 3);
  // Points: S -= W V^-1 W^T, over each point's own few columns.
  std::vector<Eigen::Vector3d> dense;
  std::vector<int> columns;
  for (std::size_t k = 0; k < points.size(); ++k) {
    auto& part = points[k];
    std::sort(part.w.begin(), part.w.end(), [](const auto& x, const auto& y) { return x.first < y.first; });
    columns.clear();
    dense.clear();
    for (const auto& [column, w] : part.w) {
      if (!columns.empty() && columns.back() == column)
        dense.back() += w;
      else {
        columns.push_back(column);
        dense.push_back(w);
      }
    }
    const Eigen::Matrix3d damped = part.v + Eigen::Matrix3d::Identity() * (1e-12 * part.v.trace() + 1e-12);
    const Eigen::Matrix3d inverse = damped.inverse();
    const bool surface = heights_from_kept_.rows() > 0;
    const Eigen::RowVector3d weight =
        surface ? Eigen::RowVector3d(weights.row(static_cast<Eigen::Index>(k))) : Eigen::RowVector3d::Zero();
    if (surface) heights_own_ += inverse(2, 2) * weight.transpose() * weight;
    for (std::size_t a = 0; a < columns.size(); ++a) {
      const Eigen::Vector3d wv = inverse * dense[a];
      if (surface) heights_from_kept_.row(columns[a]) -= wv.z() * weight;
      for (std::size_t b = 0; b <= a; ++b) entries.emplace_back(columns[a], columns[b], -wv.dot(dense[b]));
    }
    part = {};
  }
  Eigen::SparseMatrix<double> reduced(size_, size_);
  reduced.setFromTriplets(entries.begin(), entries.end());
  factor_.compute(reduced);
}

}  // namespace overfly::tiling::adjust::detail
