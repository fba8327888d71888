#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>

#include "capture/pose.h"
#include "config/error.h"

namespace overfly::capture {

// How a camera sits on what the poses are of (an autopilot's body, a gimbal), and how its clock stands.
struct CameraMount {
  Eigen::Vector3d lever_arm_in_body = Eigen::Vector3d::Zero();           // camera centre, body axes, metres
  Eigen::Quaterniond body_from_camera = Eigen::Quaterniond::Identity();  // boresight
  // Added to a capture time before the poses are asked: positive when the frames' stamps are early.
  std::int64_t delay_ns = 0;
};

// Boresight of a camera that is turned from its mount's axes (forward, right, down) by roll, pitch and yaw
// (Z-Y'-X'', radians). All zero looks along forward with the image's top up; a camera that looks straight
// down from a body has pitch -pi/2.
[[nodiscard]] Eigen::Quaterniond bodyFromCamera(double roll, double pitch, double yaw);

struct PoseTrackOptions {
  // Two poses further apart than this have a gap between them that is not bridged. Raising it lets slow
  // telemetry through, at an uncertainty that grows with the square of the gap.
  std::int64_t max_gap_ns = 500'000'000;
  // Older poses than this, counted from the newest, are forgotten; 0: none are.
  std::int64_t keep_ns = 120'000'000'000;
  // 1 sigma of what the body does between two poses and the interpolation cannot know.
  double acceleration = 2.0;          // m/s^2
  double angular_acceleration = 1.0;  // rad/s^2
};

// Poses of a body in time, and the pose of a camera on it at any moment between. Rotation by SLERP on the
// shortest arc (the sign of a quaternion does not matter), position by a cubic through the neighbours' finite
// differences (Catmull-Rom for uneven times). Covariances are interpolated and grow between poses by
// (sigma t (T - t) / 2)^2, the remainder of linear interpolation for an acceleration of sigma, t after one
// pose and T - t before the next. Thread-safe.
class PoseTrack {
 public:
  explicit PoseTrack(const PoseTrackOptions& options = {}) : options_(options) {}

  // Adds a pose of the body (Pose::ecef_from_camera holds ecef_from_body), in any order; one of the same time
  // replaces the older. BadInput: not finite, or no unit quaternion.
  [[nodiscard]] Result<void> add(const Pose& body);

  // The camera's pose at a capture time (its time_ns). Unavailable: the track ends before it, a later pose
  // may bring it; NotFound: before the track, in a gap, or the track is empty. The message says which.
  [[nodiscard]] Result<Pose> at(std::int64_t capture_time_ns, const CameraMount& mount = {}) const;

  [[nodiscard]] std::size_t size() const;
  // Time of the oldest pose that is kept; nullopt when there is none.
  [[nodiscard]] std::optional<std::int64_t> oldest() const;

 private:
  [[nodiscard]] Result<Pose> bodyAt(std::int64_t time_ns) const;

  const PoseTrackOptions options_;
  mutable std::mutex mutex_;
  std::map<std::int64_t, Pose> poses_;  // by time
};

}  // namespace overfly::capture
