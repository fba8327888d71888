#pragma once
#include <ceres/crs_matrix.h>
#include <ceres/problem.h>

#include <Eigen/Core>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <vector>

// Covariances of an adjustment from its normal equations. Values only; one thread.
namespace overfly::tiling::adjust::detail {

// Heights of points as a quadratic surface: which weighted sums of the heights are its coefficients.
struct QuadraticHeights {
  // One row a point, one column for each of x^2, xy, y^2 (per DomeUncertainty::kUnit squared); zero for
  // points that take no part (measured less than three times). No rows: too few points for a surface.
  Eigen::MatrixX3d weights;
  // Mean over the points of the outer product of (x^2, xy, y^2) less the plane that fits each best.
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
};
// `points`: x, y, z each, z up; `measured`: how often each was.
[[nodiscard]] QuadraticHeights quadraticHeights(const std::vector<double*>& points,
                                                const std::vector<int>& measured);

// Inverse of the normal equations after the points are eliminated (Schur complement), for the parameter
// blocks in `kept`, whose tangent sizes sum to the result's size. Points that the rest does not determine
// get a vanishing weight instead of an infinite variance.
class ReducedNormal {
 public:
  // `height_weights`: weighted sums of the points' heights (a row a point) whose covariance is wanted; or
  // empty.
  ReducedNormal(ceres::Problem& problem, const std::vector<double*>& kept, const std::vector<double*>& points,
                const Eigen::MatrixX3d& height_weights, int threads);

  // Columns [first, first + n) of the inverse, rows the same.
  [[nodiscard]] Eigen::MatrixXd inverseBlock(int first, int n) const;
  // Of the weighted sums of heights: from `kept`, and from the points' own measurements. Zero without
  // weights.
  [[nodiscard]] Eigen::Matrix3d heightsCovariance() const;
  [[nodiscard]] bool good() const { return factor_.info() == Eigen::Success; }

 private:
  void build(const ceres::CRSMatrix& j, int kept_size, int point_count, const Eigen::MatrixX3d& weights);

  int size_ = 0;
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>, Eigen::Lower> factor_;
  Eigen::MatrixX3d heights_from_kept_;  // derivatives of the sums by `kept`, transposed
  Eigen::Matrix3d heights_own_ = Eigen::Matrix3d::Zero();
};

}  // namespace overfly::tiling::adjust::detail
