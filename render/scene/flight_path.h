#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>

#include "capture/geo/geodetic.h"
#include "capture/pose.h"
#include "render/scene/description.h"

namespace overfly::scene {

// Where the camera is and how it looks, in the scene's ENU frame.
struct CameraState {
  Eigen::Vector3d position{0, 0, 0};  // metres
  Eigen::Quaterniond enu_from_camera = Eigen::Quaterniond::Identity();

  [[nodiscard]] Eigen::Vector3d enuFromCamera(const Eigen::Vector3d& p) const {
    return position + enu_from_camera * p;
  }
  [[nodiscard]] Eigen::Vector3d cameraFromEnu(const Eigen::Vector3d& p) const {
    return enu_from_camera.conjugate() * (p - position);
  }
};

// Speeds of a camera, in its own axes.
struct CameraMotion {
  Eigen::Vector3d velocity{0, 0, 0};  // metres per second
  Eigen::Vector3d rotation{0, 0, 0};  // radians per second
};

// The drone's way as a smooth function of time: what every exact pose, every row of a rolling shutter and
// every blur is taken from. Value type; reentrant.
class FlightPath {
 public:
  FlightPath(const PathDescription& path, const capture::CameraModel& camera, std::uint32_t seed);

  [[nodiscard]] int frames() const { return path_.frames; }
  // Middle of the exposure of a frame, seconds from the flight's start; strictly increasing.
  [[nodiscard]] double timeOf(int frame) const;
  // From the start to the last frame, seconds.
  [[nodiscard]] double duration() const { return timeOf(path_.frames - 1); }
  [[nodiscard]] CameraState at(double time_s) const;
  [[nodiscard]] CameraMotion motionAt(double time_s) const;  // central difference over 2 ms
  // Ground sampling distance straight down at path.ground, metres.
  [[nodiscard]] double gsd() const;

 private:
  struct Bare {
    Eigen::Vector3d position;
    double yaw;  // from north over east
    double pitch;
  };
  [[nodiscard]] Bare bareAt(double time_s) const;
  [[nodiscard]] Bare mowerAt(double time_s) const;
  [[nodiscard]] Bare wayPointsAt(double time_s) const;

  PathDescription path_;
  double focal_px_;
  std::uint32_t seed_;
  double interval_s_ = 1;
  int per_line_ = 1;        // LawnMower: frames of a line
  double line_step_ = 0;    // between lines, metres
  double line_length_ = 0;  // first to last frame of a line, metres
  double line_time_s_ = 0;  // start of one line to start of the next
};

// The pose of a state at a time, in ECEF; covariance zero: it is exact.
[[nodiscard]] capture::Pose poseOf(const geo::LocalFrame& local, const CameraState& state,
                                   std::int64_t time_ns);

}  // namespace overfly::scene
