#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>

namespace overfly::capture {

// Where the camera was and how it looked when the middle of the exposure happened. Value type.
struct Pose {
  std::int64_t time_ns = 0;  // CLOCK_BOOTTIME of the recording device, nanoseconds
  Eigen::Vector3d position_in_ecef = Eigen::Vector3d::Zero();  // camera centre, WGS84 ECEF, metres
  // Rotates camera axes (x right, y down, z forward) into ECEF; unit length; q and -q are the same pose.
  Eigen::Quaterniond ecef_from_camera = Eigen::Quaterniond::Identity();
  // Position in the local ENU at the pose (m^2), then a rotation vector applied on the ENU side (rad^2).
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();

  EIGEN_MAKE_ALIGNED_OPERATOR_NEW
};

}  // namespace overfly::capture
