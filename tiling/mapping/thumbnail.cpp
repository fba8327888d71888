#include "tiling/mapping/thumbnail.h"

#include <cmath>

namespace overfly::tiling {

std::optional<float> Thumbnail::at(const Eigen::Vector2d& pixel) const {
  const double x = pixel.x() - 0.5, y = pixel.y() - 0.5;
  if (!(x >= 0) || !(y >= 0) || x > camera.width - 1.001 || y > camera.height - 1.001) return std::nullopt;
  const int ix = static_cast<int>(x), iy = static_cast<int>(y);
  const auto fx = static_cast<float>(x - ix), fy = static_cast<float>(y - iy);
  const auto* row = &luma[static_cast<std::size_t>(iy) * static_cast<std::size_t>(camera.width) +
                          static_cast<std::size_t>(ix)];
  const auto* below = row + camera.width;
  const auto value = [](std::uint8_t coded) { return static_cast<float>(coded) / 255.0f; };
  return (1 - fy) * ((1 - fx) * value(row[0]) + fx * value(row[1])) +
         fy * ((1 - fx) * value(below[0]) + fx * value(below[1]));
}

Thumbnail Thumbnail::halved() const {
  Thumbnail out{frame_id, camera.scaled(0.5), pose, {}};
  out.camera.width = camera.width / 2;
  out.camera.height = camera.height / 2;
  out.luma.reserve(static_cast<std::size_t>(out.camera.width) * static_cast<std::size_t>(out.camera.height));
  for (int y = 0; y < out.camera.height; ++y)
    for (int x = 0; x < out.camera.width; ++x) {
      const auto* row = &luma[static_cast<std::size_t>(2 * y) * static_cast<std::size_t>(camera.width) +
                              static_cast<std::size_t>(2 * x)];
      const auto* below = row + camera.width;
      out.luma.push_back(static_cast<std::uint8_t>((row[0] + row[1] + below[0] + below[1] + 2) / 4));
    }
  return out;
}

LumaPairs pairsOnGround(const Thumbnail& from, const Thumbnail& to, double ground_height_m, int stride) {
  LumaPairs pairs;
  const geo::Geodetic centre = geo::geodeticFromEcef(from.pose.position_in_ecef);
  const geo::LocalFrame local({centre.lat, centre.lon, ground_height_m});
  const double height = centre.height_m - ground_height_m;
  if (!(height > 0)) return pairs;
  const Eigen::Matrix3d enu_from_a =
      local.enuFromEcefRotation() * from.pose.ecef_from_camera.toRotationMatrix();
  const Eigen::Matrix3d b_from_enu =
      to.pose.ecef_from_camera.toRotationMatrix().transpose() * local.enuFromEcefRotation().transpose();
  const Eigen::Vector3d a_in_enu = local.enuFromEcef(from.pose.position_in_ecef);
  const Eigen::Vector3d b_in_enu = local.enuFromEcef(to.pose.position_in_ecef);
  const capture::CameraModel &ca = from.camera, &cb = to.camera;
  for (int y = stride / 2; y < ca.height; y += stride)
    for (int x = stride / 2; x < ca.width; x += stride) {
      const std::uint8_t coded = from.luma[static_cast<std::size_t>(y) * static_cast<std::size_t>(ca.width) +
                                           static_cast<std::size_t>(x)];
      ++pairs.tried;
      const Eigen::Vector3d ray =
          enu_from_a * Eigen::Vector3d((x + 0.5 - ca.cx) / ca.fx, (y + 0.5 - ca.cy) / ca.fy, 1.0);
      if (ray.z() > -0.1) continue;
      const Eigen::Vector3d p = b_from_enu * (a_in_enu - ray * (a_in_enu.z() / ray.z()) - b_in_enu);
      if (p.z() <= 0) continue;
      const auto other = to.at({cb.fx * p.x() / p.z() + cb.cx, cb.fy * p.y() / p.z() + cb.cy});
      if (!other) continue;
      pairs.a.push_back(static_cast<float>(coded) / 255.0f);
      pairs.b.push_back(*other);
    }
  return pairs;
}

}  // namespace overfly::tiling
