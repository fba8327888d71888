#include "render/scene/flight_path.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "capture/geo/footprint.h"
#include "render/scene/random.h"

namespace overfly::scene {
namespace {
constexpr double kTurnPause_s = 2;    // beyond the half circle, at the end of each line
constexpr double kDriftPeriod_s = 9;  // of the wind's drift and sway
constexpr double kSwayPeriod_s = 3.5;
}  // namespace

FlightPath::FlightPath(const PathDescription& path, const capture::CameraModel& camera, std::uint32_t seed)
    : path_(path), focal_px_(camera.fy), seed_(seedOf(seed, "path")) {
  const double above = path.height - path.ground;
  interval_s_ = path.interval_s > 0 ? path.interval_s : 1;
  if (path.kind == PathDescription::Kind::LawnMower) {
    const double step = above * camera.height / camera.fy * (1 - path.forward_overlap);
    if (path.interval_s <= 0) interval_s_ = step / path.speed;
    per_line_ = (path.frames + path.lines - 1) / path.lines;
    line_step_ = above * camera.width / camera.fx * (1 - path.side_overlap);
    line_length_ = (per_line_ - 1) * interval_s_ * path.speed;
    line_time_s_ = (line_length_ + 0.5 * std::numbers::pi * line_step_) / path.speed + kTurnPause_s;
  }
}

double FlightPath::gsd() const { return (path_.height - path_.ground) / focal_px_; }

double FlightPath::timeOf(int frame) const {
  if (path_.kind != PathDescription::Kind::LawnMower) return frame * interval_s_;
  return frame / per_line_ * line_time_s_ + frame % per_line_ * interval_s_;
}

FlightPath::Bare FlightPath::mowerAt(double time_s) const {
  const int lines = (path_.frames + per_line_ - 1) / per_line_;
  // Half the turn belongs to the line before, half to the line after: states stay smooth around every frame.
  const double turn_s = line_time_s_ - line_length_ / path_.speed;
  const int line =
      std::clamp(static_cast<int>(std::floor((time_s + 0.5 * turn_s) / line_time_s_)), 0, lines - 1);
  const double along = (time_s - line * line_time_s_) * path_.speed - 0.5 * line_length_;
  const double way = line % 2 == 0 ? 1 : -1;
  const double across = (line - 0.5 * (lines - 1)) * line_step_;
  const Eigen::Vector2d forward(std::sin(path_.heading), std::cos(path_.heading)),
      right(forward.y(), -forward.x());
  const Eigen::Vector2d p = path_.centre + way * along * forward + across * right;
  return {{p.x(), p.y(), path_.height}, path_.heading + (way > 0 ? 0 : std::numbers::pi), path_.pitch};
}

FlightPath::Bare FlightPath::wayPointsAt(double time_s) const {
  double left = std::max(0.0, time_s) * path_.speed;
  for (std::size_t i = 0; i + 1 < path_.points.size(); ++i) {
    const Eigen::Vector3d along = path_.points[i + 1] - path_.points[i];
    const double length = along.norm();
    if (left <= length || i + 2 == path_.points.size()) {
      return {path_.points[i] + left / length * along, std::atan2(along.x(), along.y()), path_.pitch};
    }
    left -= length;
  }
  return {path_.points.front(), 0, path_.pitch};
}

FlightPath::Bare FlightPath::bareAt(double time_s) const {
  switch (path_.kind) {
    case PathDescription::Kind::LawnMower:
      return mowerAt(time_s);
    case PathDescription::Kind::WayPoints:
      return wayPointsAt(time_s);
    case PathDescription::Kind::Orbit:
      break;
  }
  const double angle = path_.heading + path_.speed / path_.radius * time_s;
  const Eigen::Vector2d p = path_.centre + path_.radius * Eigen::Vector2d(std::sin(angle), std::cos(angle));
  return {{p.x(), p.y(), path_.height}, angle + std::numbers::pi, path_.pitch};  // looks at the centre
}

CameraState FlightPath::at(double time_s) const {
  Bare bare = bareAt(time_s);
  double roll = 0;
  if (path_.drift > 0) {
    for (std::uint32_t axis = 0; axis < 3; ++axis) {
      bare.position[axis] += path_.drift * (axis == 2 ? 0.4 : 1.0) / std::numbers::sqrt2 *
                             smoothNoise(hashOf(seed_, 1, axis), time_s, kDriftPeriod_s);
    }
  }
  if (path_.sway > 0) {
    roll = path_.sway * smoothNoise(hashOf(seed_, 2, 0), time_s, kSwayPeriod_s);
    bare.pitch += path_.sway * smoothNoise(hashOf(seed_, 2, 1), time_s, kSwayPeriod_s);
    bare.yaw += 1.5 * path_.sway * smoothNoise(hashOf(seed_, 2, 2), time_s, kSwayPeriod_s);
  }
  CameraState state;
  state.position = bare.position;
  state.enu_from_camera = geo::enuFromCamera(bare.yaw, bare.pitch, roll);
  return state;
}

CameraMotion FlightPath::motionAt(double time_s) const {
  constexpr double kStep = 1e-3;
  const CameraState before = at(time_s - kStep), after = at(time_s + kStep), now = at(time_s);
  CameraMotion motion;
  motion.velocity = now.enu_from_camera.conjugate() * (after.position - before.position) / (2 * kStep);
  const Eigen::AngleAxisd turn(before.enu_from_camera.conjugate() * after.enu_from_camera);
  motion.rotation = turn.angle() * turn.axis() / (2 * kStep);
  return motion;
}

capture::Pose poseOf(const geo::LocalFrame& local, const CameraState& state, std::int64_t time_ns) {
  capture::Pose pose;
  pose.time_ns = time_ns;
  pose.position_in_ecef = local.ecefFromEnu(state.position);
  const Eigen::Quaterniond ecef_from_enu(Eigen::Matrix3d(local.enuFromEcefRotation().transpose()));
  pose.ecef_from_camera = (ecef_from_enu * state.enu_from_camera).normalized();
  return pose;
}

}  // namespace overfly::scene
