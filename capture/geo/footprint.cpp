#include "capture/geo/footprint.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace overfly::geo {
namespace {

constexpr double kEquatorialRadius_m = 6378137.0;
constexpr double kPolarRadius_m = 6356752.314245179;
constexpr double kMinHeight_m = 0.01;  // above this, heights differ by more than rounding
constexpr const char* kCornerNames[] = {"top-left", "top-right", "bottom-right", "bottom-left"};

// Body axes (x forward, y right, z down) of a camera (z forward, x right, y down).
Eigen::Matrix3d bodyFromCamera() {
  Eigen::Matrix3d m;
  m << 0, 0, 1,  //
      1, 0, 0,   //
      0, 1, 0;
  return m;
}

// ENU from NED, and its own inverse.
Eigen::Matrix3d enuFromNed() {
  Eigen::Matrix3d m;
  m << 0, 1, 0,  //
      1, 0, 0,   //
      0, 0, -1;
  return m;
}

// The direction of a pixel, or of the outermost valid pixel between it and the principal point.
Eigen::Vector3d outermostDirection(const capture::CameraModel& camera, const Eigen::Vector2d& pixel) {
  const Eigen::Vector2d principal(camera.cx, camera.cy);
  for (double pull = 1; pull > 0.02; pull -= 0.02)
    if (const auto direction = camera.unproject(principal + pull * (pixel - principal))) return *direction;
  return Eigen::Vector3d::UnitZ();
}

// The point of the view pyramid's base that a pixel sees, in ECEF.
Eigen::Vector3d basePoint(const capture::CameraModel& camera, const capture::Pose& pose,
                          const Eigen::Vector2d& pixel, double depth_m) {
  constexpr double kMinCosine = 0.087;  // 85 deg
  const Eigen::Vector3d direction = outermostDirection(camera, pixel);
  const double range_m = direction.z() > kMinCosine ? depth_m / direction.z() : depth_m;
  return pose.position_in_ecef + range_m * (pose.ecef_from_camera.normalized() * direction);
}

}  // namespace

std::optional<Eigen::Vector3d> intersectHeight(const Eigen::Vector3d& origin_in_ecef,
                                               const Eigen::Vector3d& direction_in_ecef, double height_m) {
  const double origin_height_m = geodeticFromEcef(origin_in_ecef).height_m;
  if (!(origin_height_m > height_m)) return std::nullopt;
  // First guess: the ellipsoid with both axes longer by the height, which is within a millimetre of the
  // surface of constant height for the Earth's flattening; the nearer of the two crossings.
  const Eigen::Vector3d scale(1 / (kEquatorialRadius_m + height_m), 1 / (kEquatorialRadius_m + height_m),
                              1 / (kPolarRadius_m + height_m));
  const Eigen::Vector3d o = origin_in_ecef.cwiseProduct(scale), d = direction_in_ecef.cwiseProduct(scale);
  const double a = d.squaredNorm(), b = o.dot(d), c = o.squaredNorm() - 1;
  const double discriminant = b * b - a * c;
  if (!(discriminant > 0) || b >= 0) return std::nullopt;
  double range_m = c / (-b + std::sqrt(discriminant));  // the form without cancellation for low cameras
  for (int i = 0; i < 8; ++i) {
    const Geodetic at = geodeticFromEcef(origin_in_ecef + range_m * direction_in_ecef);
    const double descent = -direction_in_ecef.dot(upInEcef(at.lat, at.lon));
    if (!(descent > 0)) return std::nullopt;  // grazes the horizon
    const double step_m = (at.height_m - height_m) / descent;
    range_m += step_m;
    if (std::abs(step_m) < 1e-7) break;
  }
  const Eigen::Vector3d hit = origin_in_ecef + range_m * direction_in_ecef;
  if (!(range_m > 0) || !(std::abs(geodeticFromEcef(hit).height_m - height_m) < 1e-6)) return std::nullopt;
  return hit;
}

Result<Footprint> footprint(const capture::CameraModel& camera, const capture::Pose& pose, double height_m,
                            const FootprintLimits& limits) {
  const Eigen::Vector3d& origin = pose.position_in_ecef;
  if (!origin.allFinite() || !pose.ecef_from_camera.coeffs().allFinite() || !std::isfinite(height_m))
    return fail(ErrorCode::BadInput, "the pose or the surface height is not a number");
  const Geodetic at = geodeticFromEcef(origin);
  Footprint print;
  print.height_above_m = at.height_m - height_m;
  if (!(print.height_above_m > kMinHeight_m))
    return fail(ErrorCode::BadInput,
                fmt::format("the camera is at or below the surface ({:.2f} m below height {:.1f} m)",
                            -print.height_above_m, height_m));
  const Eigen::Matrix3d ecef_from_camera = pose.ecef_from_camera.normalized().toRotationMatrix();
  const Eigen::Vector3d down = -upInEcef(at.lat, at.lon);
  print.tilt = std::acos(std::clamp(ecef_from_camera.col(2).dot(down), -1.0, 1.0));

  const auto hit = [&](const Eigen::Vector2d& pixel) -> std::optional<Eigen::Vector3d> {
    const auto direction = camera.unproject(pixel);
    if (!direction) return std::nullopt;
    return intersectHeight(origin, ecef_from_camera * *direction, height_m);
  };
  const double w = camera.width, h = camera.height;
  const std::array<Eigen::Vector2d, 4> pixels = {Eigen::Vector2d(0, 0), Eigen::Vector2d(w, 0),
                                                 Eigen::Vector2d(w, h), Eigen::Vector2d(0, h)};
  std::array<Eigen::Vector3d, 4> corners;
  const Eigen::Vector3d nadir = ecefFromGeodetic({at.lat, at.lon, height_m});
  double length_m = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto corner = hit(pixels[i]);
    if (!corner)
      return fail(ErrorCode::BadInput,
                  camera.unproject(pixels[i])
                      ? fmt::format("the {} corner looks at or above the horizon (tilt {:.1f} deg)",
                                    kCornerNames[i], degrees(print.tilt))
                      : fmt::format("the lens model is not valid at the {} corner", kCornerNames[i]));
    corners[i] = *corner;
    print.corners[i] = geodeticFromEcef(*corner);
    length_m = std::max(length_m, (corners[i] - nadir).norm());
    for (std::size_t j = 0; j < i; ++j) length_m = std::max(length_m, (corners[i] - corners[j]).norm());
  }
  if (!(length_m <= limits.max_length_per_height * print.height_above_m))
    return fail(
        ErrorCode::BadInput,
        fmt::format("the footprint reaches {:.0f} m from a height of {:.1f} m, more than {:g} times it",
                    length_m, print.height_above_m, limits.max_length_per_height));

  const Eigen::Vector2d principal(camera.cx, camera.cy);
  const auto centre = intersectHeight(origin, ecef_from_camera.col(2), height_m);
  const auto right = hit(principal + Eigen::Vector2d(1, 0)), below = hit(principal + Eigen::Vector2d(0, 1));
  if (!centre || !right || !below)
    return fail(ErrorCode::BadInput, "the principal axis does not meet the ground");
  print.centre = geodeticFromEcef(*centre);
  print.gsd_m = std::sqrt((*right - *centre).cross(*below - *centre).norm());
  return print;
}

Box3 viewPyramidBox(const capture::CameraModel& camera, const capture::Pose& pose, double depth_m) {
  constexpr int kStepsPerEdge = 4;  // distorted edges bulge beyond the corners
  Box3 box{pose.position_in_ecef, pose.position_in_ecef};
  const double w = camera.width, h = camera.height;
  const auto include = [&](double x, double y) {
    const Eigen::Vector3d point = basePoint(camera, pose, {x, y}, depth_m);
    box.min = box.min.cwiseMin(point);
    box.max = box.max.cwiseMax(point);
  };
  for (int i = 0; i <= kStepsPerEdge; ++i) {
    const double f = static_cast<double>(i) / kStepsPerEdge;
    include(f * w, 0);
    include(f * w, h);
    include(0, f * h);
    include(w, f * h);
  }
  include(camera.cx, camera.cy);
  return box;
}

std::array<Eigen::Vector3d, 4> viewPyramidBase(const capture::CameraModel& camera, const capture::Pose& pose,
                                               double depth_m) {
  const double w = camera.width, h = camera.height;
  return {basePoint(camera, pose, {0, 0}, depth_m), basePoint(camera, pose, {w, 0}, depth_m),
          basePoint(camera, pose, {w, h}, depth_m), basePoint(camera, pose, {0, h}, depth_m)};
}

Eigen::Quaterniond enuFromCamera(double yaw, double pitch, double roll) {
  const Eigen::Quaterniond ned_from_body = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                                           Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
                                           Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX());
  return (Eigen::Quaterniond(enuFromNed()) * ned_from_body * Eigen::Quaterniond(bodyFromCamera()))
      .normalized();
}

YawPitchRoll yawPitchRoll(const Eigen::Quaterniond& enu_from_camera) {
  const Eigen::Matrix3d ned_from_body =
      enuFromNed() * enu_from_camera.normalized().toRotationMatrix() * bodyFromCamera().transpose();
  YawPitchRoll angles;
  const double level = std::hypot(ned_from_body(0, 0), ned_from_body(1, 0));
  angles.pitch = std::atan2(-ned_from_body(2, 0), level);
  if (level > 1e-9) {
    angles.yaw = std::atan2(ned_from_body(1, 0), ned_from_body(0, 0));
    angles.roll = std::atan2(ned_from_body(2, 1), ned_from_body(2, 2));
  } else {
    angles.yaw = std::atan2(-ned_from_body(0, 1), ned_from_body(1, 1));
  }
  return angles;
}

}  // namespace overfly::geo
