#include "render/scene/detail/view.h"

#include <algorithm>
#include <array>
#include <limits>

namespace overfly::scene {

bool View::sees(const Eigen::AlignedBox3f& box, double margin) const {
  std::array<int, 5> outside{};
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector3d p =
        state.cameraFromEnu(box.corner(static_cast<Eigen::AlignedBox3f::CornerType>(i)).cast<double>());
    const double x = camera.fx * p.x() + camera.cx * p.z(), y = camera.fy * p.y() + camera.cy * p.z();
    const double mx = margin * camera.width * p.z(), my = margin * camera.height * p.z();
    outside[0] += x < -mx ? 1 : 0;
    outside[1] += x > camera.width * p.z() + mx ? 1 : 0;
    outside[2] += y < -my ? 1 : 0;
    outside[3] += y > camera.height * p.z() + my ? 1 : 0;
    outside[4] += p.z() <= 0 ? 1 : 0;
  }
  return std::none_of(outside.begin(), outside.end(), [](int corners) { return corners == 8; });
}

std::pair<double, double> View::depthsOf(const Eigen::AlignedBox3f& box) const {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (int i = 0; i < 8; ++i) {
    const double z =
        state.cameraFromEnu(box.corner(static_cast<Eigen::AlignedBox3f::CornerType>(i)).cast<double>()).z();
    low = std::min(low, z);
    high = std::max(high, z);
  }
  return {low, high};
}

}  // namespace overfly::scene
