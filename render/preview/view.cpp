#include "render/preview/view.h"

#include <cmath>
#include <optional>

namespace overfly::preview {

double View::focal() const { return 0.5 * width / std::tan(0.5 * fov); }

Eigen::Matrix3d View::enuFromCamera() const {
  const double sh = std::sin(heading), ch = std::cos(heading), sp = std::sin(pitch), cp = std::cos(pitch);
  Eigen::Matrix3d m;
  m.col(0) = Eigen::Vector3d(ch, -sh, 0);            // right
  m.col(2) = Eigen::Vector3d(sh * cp, ch * cp, sp);  // ahead
  m.col(1) = m.col(2).cross(m.col(0));               // down
  return m;
}

Eigen::Vector3d View::direction(double x, double y) const {
  const double f = focal();
  return enuFromCamera() * Eigen::Vector3d((x - 0.5 * width) / f, (y - 0.5 * height) / f, 1).normalized();
}

Result<RayFrame> RayFrame::create(const Domain& domain, const geo::Geodetic& position, double base_height_m) {
  const geo::LocalFrame frame(position);
  const geo::TileLattice& lattice = domain.lattice();
  const double near_px = domain.planeFromTexel((domain.minTexel() + domain.maxTexel()) / 2).x();
  const auto map = [&](const Eigen::Vector3d& enu) -> std::optional<Eigen::Vector3d> {
    const geo::Geodetic point = geo::geodeticFromEcef(frame.ecefFromEnu(enu));
    const auto plane = lattice.planeFromGeodetic(point.lat, point.lon, near_px);
    if (!plane) return std::nullopt;
    const Eigen::Vector2d texel = domain.texelFromPlane(*plane);
    return Eigen::Vector3d(texel.x(), texel.y(), point.height_m);
  };
  // Central differences: their own error is of the order that is left out.
  constexpr double kStep = 500;
  const auto centre = map(Eigen::Vector3d::Zero());
  const Error outside{ErrorCode::BadInput, "the view point lies outside the map's projection"};
  if (!centre) return tl::unexpected(outside);
  RayFrame out;
  std::array<Eigen::Vector3d, 3> minus, plus;
  for (int i = 0; i < 3; ++i) {
    const auto a = map(-kStep * Eigen::Vector3d::Unit(i)), b = map(kStep * Eigen::Vector3d::Unit(i));
    if (!a || !b) return tl::unexpected(outside);
    minus[static_cast<std::size_t>(i)] = *a;
    plus[static_cast<std::size_t>(i)] = *b;
    out.per_metre.col(i) = (*b - *a) / (2 * kStep);
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      Eigen::Vector3d second;  // of the map, along axes i and j
      if (i == j) {
        second = (plus[static_cast<std::size_t>(i)] - 2 * *centre + minus[static_cast<std::size_t>(i)]) /
                 (kStep * kStep);
      } else {
        const Eigen::Vector3d u = kStep * Eigen::Vector3d::Unit(i), v = kStep * Eigen::Vector3d::Unit(j);
        const auto a = map(u + v), b = map(u - v), c = map(v - u), d = map(-u - v);
        if (!a || !b || !c || !d) return tl::unexpected(outside);
        second = (*a - *b - *c + *d) / (4 * kStep * kStep);
      }
      for (int k = 0; k < 3; ++k) {
        out.bend[static_cast<std::size_t>(k)](i, j) = 0.5 * second[k];
        out.bend[static_cast<std::size_t>(k)](j, i) = 0.5 * second[k];
      }
    }
  }
  const double x = std::floor(centre->x()), y = std::floor(centre->y());
  constexpr double kFar = 1 << 29;
  if (std::abs(x) > kFar || std::abs(y) > kFar)
    return fail(ErrorCode::BadInput, "the view point is too far from the map");
  out.cell = {static_cast<int>(x), static_cast<int>(y)};
  out.base_height_m = base_height_m;
  out.start = {centre->x() - x, centre->y() - y, centre->z() - base_height_m};
  return out;
}

}  // namespace overfly::preview
