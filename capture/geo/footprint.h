#pragma once
#include <Eigen/Core>
#include <array>
#include <optional>

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
  // A footprint is refused when two of its corners, or a corner and the point below the camera, are further
  // apart than this multiple of the height: raising it admits flatter views, whose area grows without bound.
  double max_length_per_height = 10;
};

// BadInput with the reason when a corner's ray misses the surface (horizon, upwards), the camera is at or
// below it, or the footprint is absurdly long. The lens distortion is taken into account at the corners.
[[nodiscard]] Result<Footprint> footprint(const capture::CameraModel& camera, const capture::Pose& pose,
                                          double height_m, const FootprintLimits& limits = {});

// Where the ray from a point in a direction (ECEF, unit length) first meets the surface of constant
// ellipsoidal height, within 1 um; nullopt when it misses (horizon, upwards) or starts at or below it.
[[nodiscard]] std::optional<Eigen::Vector3d> intersectHeight(const Eigen::Vector3d& origin_in_ecef,
                                                             const Eigen::Vector3d& direction_in_ecef,
                                                             double height_m);

// Axis-aligned box of the view pyramid in ECEF metres: apex at the camera, base perpendicular to the view
// direction at `depth_m` (3.2.3, figure 3.5): for oblique frames, whose footprint may not exist. Rays at 85
// deg and more from the axis end on the sphere of that radius instead of running away.
struct Box3 {
  Eigen::Vector3d min, max;
};
[[nodiscard]] Box3 viewPyramidBox(const capture::CameraModel& camera, const capture::Pose& pose,
                                  double depth_m);
// The base's corners in ECEF: of the image top-left, top-right, bottom-right, bottom-left.
[[nodiscard]] std::array<Eigen::Vector3d, 4> viewPyramidBase(const capture::CameraModel& camera,
                                                             const capture::Pose& pose, double depth_m);

// Yaw, pitch, roll of a gimballed camera (degrees inside flight files, radians here), aerospace convention
// (NED, Z-Y'-X''): pitch -90 deg looks straight down, yaw is the heading of the image's top at nadir.
[[nodiscard]] Eigen::Quaterniond enuFromCamera(double yaw, double pitch, double roll);

// The inverse: angles that give the same rotation. Pitch in [-pi/2, pi/2], yaw and roll in [-pi, pi]; looking
// straight down or up, where only yaw +- roll is defined, roll is 0.
struct YawPitchRoll {
  double yaw = 0, pitch = 0, roll = 0;
};
[[nodiscard]] YawPitchRoll yawPitchRoll(const Eigen::Quaterniond& enu_from_camera);

}  // namespace overfly::geo
