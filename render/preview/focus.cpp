#include "render/preview/focus.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace overfly::preview {
namespace {
constexpr double kSteepest = 70.0 / 180.0 * 3.14159265358979323846;
}

double pixelAngle(const View& view) { return 1 / view.focal(); }

double levelsPerMetre(const View& view, const Domain& domain) {
  return pixelAngle(view) / domain.texelSize();
}

Focus focusOf(const View& view, const RayFrame& frame, const Domain& domain, double ground_m) {
  Focus focus;
  const double above = std::max(frame.start.z() + frame.base_height_m - ground_m, 2.0);
  const double per_metre = levelsPerMetre(view, domain);
  const Eigen::Vector3d ahead = view.direction(0.5 * view.width, 0.5 * view.height);
  // Horizontal way, heading of the view (of the picture's top, looking straight down).
  const Eigen::Vector2d heading(std::sin(view.heading), std::cos(view.heading));
  const auto reach = [&](double down) {  // horizontal distance of the ground at an angle from straight down
    return above * std::tan(std::min(down, kSteepest));
  };
  const double middle = reach(std::acos(std::clamp(-ahead.z(), -1.0, 1.0)));
  const Eigen::Vector3d lower = view.direction(0.5 * view.width, view.height);
  const double down_low = std::acos(std::clamp(-lower.z(), -1.0, 1.0));
  const bool past_foot = lower.head<2>().dot(heading) < 0;  // the camera's foot is in the picture
  const double nearest = past_foot ? 0 : std::min(reach(down_low), middle);

  double near_t = std::numeric_limits<double>::infinity(), far_t = 0;
  for (int j = 0; j <= 2; ++j) {
    for (int i = 0; i <= 2; ++i) {
      const Eigen::Vector3d d = view.direction(0.5 * i * view.width, 0.5 * j * view.height);
      const double t = d.z() < -1e-3 ? above / -d.z() : std::numeric_limits<double>::infinity();
      near_t = std::min(near_t, t);
      far_t = std::max(far_t, t);
    }
  }
  if (past_foot) near_t = above;
  // Terrain may rise above the plane: half a level finer, and nothing beyond the map.
  const double span = (domain.maxTexel() - domain.minTexel()).norm() * domain.texelSize() + 4 * above;
  const int last = domain.levels() - 2;
  const auto level = [&](double t) {
    return std::clamp(static_cast<int>(std::floor(std::log2(std::max(t * per_metre, 1e-6)))), 0, last);
  };
  focus.finest = std::isfinite(near_t) ? level(near_t * 0.7) : 0;
  focus.coarsest = std::max(level(std::min(far_t, span)), focus.finest);

  const Eigen::Vector2d foot = frame.start.head<2>() + frame.cell.cast<double>();
  const Eigen::Vector2d along = (frame.per_metre * Eigen::Vector3d(heading.x(), heading.y(), 0)).head<2>();
  for (int l = 0; l <= last; ++l) {
    const double t =
        std::ldexp(1.4, l) / per_metre;  // the middle of the band of distances that level l is for
    const double ground = std::sqrt(std::max(t * t - above * above, 0.0));
    focus.centres.emplace_back(foot + along * std::clamp(ground, nearest, std::max(nearest, middle)));
  }
  return focus;
}

}  // namespace overfly::preview
