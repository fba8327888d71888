#include "capture/record/pose_check.h"

#include <fmt/format.h>

#include <cmath>

namespace overfly::capture {

std::optional<std::string> checkPose(Pose& pose) {
  const double radius = pose.position_in_ecef.norm();
  if (!(radius > 6.336e6 && radius < 6.479e6)) {
    return fmt::format("the position is {:.0f} km from the Earth's centre", radius / 1000);
  }
  const double length = pose.ecef_from_camera.norm();
  if (!(std::abs(length - 1) < 0.01)) return fmt::format("the quaternion's length is {:.4g}, not 1", length);
  if (std::abs(length - 1) > 1e-12) pose.ecef_from_camera.normalize();
  if (!pose.covariance.allFinite() || pose.covariance.diagonal().minCoeff() < 0) {
    return "the covariance is not one";
  }
  return std::nullopt;
}

}  // namespace overfly::capture
