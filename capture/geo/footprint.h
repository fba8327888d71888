#pragma once
#include <Eigen/Core>
#include <array>

#include "capture/camera_model.h"
#include "capture/geo/geodetic.h"
#include "capture/pose.h"
#include "config/error.h"

namespace overfly::geo {

// Where a frame's view meets the surface of constant ellipsoidal height `height_m` (thesis, 3.2.3).
struct Footprint {
  std::array<Geodetic, 4> corners;  // of the image: top-left, top-right, bottom-right, bottom-left
  Geodetic centre;                  // of the principal axis
  double gsd_m = 0;                 // ground sampling distance at the centre
  double height_above_m = 0;        // camera above the surface
  double tilt = 0;                  // angle between the view direction and straight down, radians
};

struct FootprintLimits {
  double max_length_per_height = 10;  // a footprint longer than this multiple of the height is refused
};

// BadInput with the reason when a corner's ray misses the surface (horizon, upwards), the camera is at or
// below it, or the footprint is absurdly long. The lens distortion is taken into account at the corners.
[[nodiscard]] Result<Footprint> footprint(const capture::CameraModel& camera, const capture::Pose& pose,
                                          double height_m, const FootprintLimits& limits = {});

// Axis-aligned box of the view pyramid in ECEF metres: apex at the camera, base perpendicular to the view
// direction at `depth_m` (3.2.3, figure 3.5): for oblique frames, whose footprint may not exist.
struct Box3 {
  Eigen::Vector3d min, max;
};
[[nodiscard]] Box3 viewPyramidBox(const capture::CameraModel& camera, const capture::Pose& pose,
                                  double depth_m);

// Yaw, pitch, roll of a gimballed camera (degrees inside flight files, radians here), aerospace convention
// (NED, Z-Y'-X''): pitch -90 deg looks straight down, yaw is the heading of the image's top at nadir.
[[nodiscard]] Eigen::Quaterniond enuFromCamera(double yaw, double pitch, double roll);

}  // namespace overfly::geo
