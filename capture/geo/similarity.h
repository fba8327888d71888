#pragma once
#include <Eigen/Core>
#include <span>

namespace overfly::geo {

// to = scale * turn * from + shift, metres in one Cartesian frame. Value type.
struct Similarity {
  double scale = 1;
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  [[nodiscard]] Eigen::Vector3d operator()(const Eigen::Vector3d& from) const {
    return scale * (turn * from) + shift;
  }
};

// Least squares over pairs (Umeyama 1991); as many of both, at least three, not all on a line. Reentrant.
[[nodiscard]] Similarity similarityBetween(std::span<const Eigen::Vector3d> from,
                                           std::span<const Eigen::Vector3d> to);

}  // namespace overfly::geo
