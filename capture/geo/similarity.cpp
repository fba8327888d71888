#include "capture/geo/similarity.h"

#include <Eigen/Geometry>
#include <cmath>

namespace overfly::geo {

Similarity similarityBetween(std::span<const Eigen::Vector3d> from, std::span<const Eigen::Vector3d> to) {
  Eigen::Matrix3Xd a(3, from.size()), b(3, to.size());
  for (std::size_t i = 0; i < from.size(); ++i) {
    a.col(static_cast<Eigen::Index>(i)) = from[i];
    b.col(static_cast<Eigen::Index>(i)) = to[i];
  }
  const Eigen::Matrix4d t = Eigen::umeyama(a, b, true);
  Similarity s;
  s.scale = std::cbrt(t.topLeftCorner<3, 3>().determinant());
  s.turn = t.topLeftCorner<3, 3>() / s.scale;
  s.shift = t.topRightCorner<3, 1>();
  return s;
}

}  // namespace overfly::geo
