#include "capture/pose_track.h"

#include <fmt/format.h>

#include <cmath>
#include <iterator>

namespace overfly::capture {
namespace {

double seconds(std::int64_t from_ns, std::int64_t to_ns) {
  return static_cast<double>(to_ns - from_ns) * 1e-9;
}

// East, north, up at a place as rows. Up is the gradient of the ellipsoid scaled through the point: within
// 1e-5 rad of the geodetic normal up to 9 km, which is far finer than any covariance needs.
Eigen::Matrix3d enuFromEcef(const Eigen::Vector3d& place) {
  constexpr double kA2 = 6378137.0 * 6378137.0, kB2 = 6356752.314245 * 6356752.314245;
  const Eigen::Vector3d up = Eigen::Vector3d(place.x() / kA2, place.y() / kA2, place.z() / kB2).normalized();
  Eigen::Vector3d east = Eigen::Vector3d::UnitZ().cross(up);
  east = east.norm() > 1e-12 ? Eigen::Vector3d(east.normalized()) : Eigen::Vector3d::UnitY();
  Eigen::Matrix3d rows;
  rows << east.transpose(), up.cross(east).transpose(), up.transpose();
  return rows;
}

Eigen::Matrix3d crossMatrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Pose mounted(const Pose& body, const CameraMount& mount, std::int64_t capture_time_ns) {
  Pose camera = body;
  camera.time_ns = capture_time_ns;
  const Eigen::Vector3d arm_in_ecef = body.ecef_from_camera * mount.lever_arm_in_body;
  camera.position_in_ecef += arm_in_ecef;
  camera.ecef_from_camera = (body.ecef_from_camera * mount.body_from_camera).normalized();
  // A small rotation w of the body moves the camera by w x arm.
  Eigen::Matrix<double, 6, 6> jacobian = Eigen::Matrix<double, 6, 6>::Identity();
  jacobian.topRightCorner<3, 3>() = -crossMatrix(enuFromEcef(body.position_in_ecef) * arm_in_ecef);
  camera.covariance = jacobian * body.covariance * jacobian.transpose();
  camera.covariance = (0.5 * (camera.covariance + camera.covariance.transpose())).eval();
  return camera;
}

}  // namespace

Eigen::Quaterniond bodyFromCamera(double roll, double pitch, double yaw) {
  const Eigen::Matrix3d mount_from_camera{{0, 0, 1}, {1, 0, 0}, {0, 1, 0}};
  return Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()) * Eigen::Quaterniond(mount_from_camera);
}

Result<void> PoseTrack::add(const Pose& body) {
  if (!body.position_in_ecef.allFinite() || !body.covariance.allFinite() ||
      !(std::abs(body.ecef_from_camera.norm() - 1) < 1e-3)) {
    return fail(ErrorCode::BadInput, "a pose that is not finite, or whose quaternion is not of unit length");
  }
  const std::lock_guard lock(mutex_);
  poses_.insert_or_assign(body.time_ns, body).first->second.ecef_from_camera.normalize();
  if (options_.keep_ns > 0) {
    const std::int64_t newest = poses_.rbegin()->first;
    while (newest - poses_.begin()->first > options_.keep_ns) poses_.erase(poses_.begin());
  }
  return {};
}

std::size_t PoseTrack::size() const {
  const std::lock_guard lock(mutex_);
  return poses_.size();
}

std::optional<std::int64_t> PoseTrack::oldest() const {
  const std::lock_guard lock(mutex_);
  return poses_.empty() ? std::nullopt : std::optional(poses_.begin()->first);
}

Result<Pose> PoseTrack::at(std::int64_t capture_time_ns, const CameraMount& mount) const {
  const std::lock_guard lock(mutex_);
  const auto body = bodyAt(capture_time_ns + mount.delay_ns);
  if (!body) return body;
  return mounted(*body, mount, capture_time_ns);
}

Result<Pose> PoseTrack::bodyAt(std::int64_t time_ns) const {
  if (poses_.empty()) return fail(ErrorCode::NotFound, "no pose has come yet");
  const auto after = poses_.lower_bound(time_ns);
  if (after == poses_.end()) {
    return fail(ErrorCode::Unavailable, fmt::format("the last pose is {:.3f} s older than the frame",
                                                    seconds(poses_.rbegin()->first, time_ns)));
  }
  if (after->first == time_ns) return after->second;
  if (after == poses_.begin()) {
    return fail(ErrorCode::NotFound, fmt::format("the first pose is {:.3f} s younger than the frame",
                                                 seconds(time_ns, after->first)));
  }
  const auto before = std::prev(after);
  if (after->first - before->first > options_.max_gap_ns) {
    return fail(
        ErrorCode::NotFound,
        fmt::format("the poses around the frame are {:.3f} s apart, more than the {:.3f} s allowed",
                    seconds(before->first, after->first), 1e-9 * static_cast<double>(options_.max_gap_ns)));
  }
  const Pose& a = before->second;
  const Pose& b = after->second;
  const double length = seconds(a.time_ns, b.time_ns), passed = seconds(a.time_ns, time_ns);
  const double s = passed / length;

  // Velocities at both ends (differences are taken from `a`, so that no large number is rounded): the
  // derivative of the parabola through a pose and its neighbours, or the chord where a neighbour is missing
  // or across a gap.
  const Eigen::Vector3d chord = b.position_in_ecef - a.position_in_ecef;
  const auto velocity = [&](const Eigen::Vector3d& outer, double outer_length) -> Eigen::Vector3d {
    return (outer / outer_length * length + chord / length * outer_length) / (length + outer_length);
  };
  Eigen::Vector3d velocity_a = chord / length, velocity_b = velocity_a;
  if (before != poses_.begin()) {
    const Pose& outer = std::prev(before)->second;
    if (a.time_ns - outer.time_ns <= options_.max_gap_ns) {
      velocity_a = velocity(a.position_in_ecef - outer.position_in_ecef, seconds(outer.time_ns, a.time_ns));
    }
  }
  if (const auto next = std::next(after); next != poses_.end()) {
    if (next->first - b.time_ns <= options_.max_gap_ns) {
      velocity_b =
          velocity(next->second.position_in_ecef - b.position_in_ecef, seconds(b.time_ns, next->first));
    }
  }
  Pose pose;
  pose.time_ns = time_ns;
  const double s2 = s * s, s3 = s2 * s;
  pose.position_in_ecef = a.position_in_ecef + (3 * s2 - 2 * s3) * chord +
                          (s3 - 2 * s2 + s) * length * velocity_a + (s3 - s2) * length * velocity_b;
  pose.ecef_from_camera = a.ecef_from_camera.slerp(s, b.ecef_from_camera).normalized();
  pose.covariance = (1 - s) * a.covariance + s * b.covariance;
  const double reach = 0.5 * passed * (length - passed);
  pose.covariance.diagonal().head<3>().array() += std::pow(options_.acceleration * reach, 2);
  pose.covariance.diagonal().tail<3>().array() += std::pow(options_.angular_acceleration * reach, 2);
  return pose;
}

}  // namespace overfly::capture
