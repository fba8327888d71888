#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>

namespace overfly::geo {

// WGS84. Latitude and longitude in radians, ellipsoidal height in metres.
struct Geodetic {
  double lat = 0;
  double lon = 0;
  double height_m = 0;
};

[[nodiscard]] Eigen::Vector3d ecefFromGeodetic(const Geodetic& point);
[[nodiscard]] Geodetic geodeticFromEcef(const Eigen::Vector3d& point_in_ecef);
// The ellipsoid's outward normal there, unit length: a point at height h is its foot point plus h times this.
[[nodiscard]] Eigen::Vector3d upInEcef(double lat, double lon);

[[nodiscard]] constexpr double radians(double degrees) { return degrees * 3.14159265358979323846 / 180.0; }
[[nodiscard]] constexpr double degrees(double rad) { return rad * 180.0 / 3.14159265358979323846; }

// A local East-North-Up frame at an origin on or above the ellipsoid. Value type, reentrant.
class LocalFrame {
 public:
  explicit LocalFrame(const Geodetic& origin);
  [[nodiscard]] const Geodetic& origin() const { return origin_; }
  [[nodiscard]] Eigen::Vector3d enuFromEcef(const Eigen::Vector3d& point_in_ecef) const {
    return enu_from_ecef_ * (point_in_ecef - origin_in_ecef_);
  }
  [[nodiscard]] Eigen::Vector3d ecefFromEnu(const Eigen::Vector3d& point_in_enu) const {
    return enu_from_ecef_.transpose() * point_in_enu + origin_in_ecef_;
  }
  [[nodiscard]] const Eigen::Matrix3d& enuFromEcefRotation() const { return enu_from_ecef_; }

 private:
  Geodetic origin_;
  Eigen::Vector3d origin_in_ecef_;
  Eigen::Matrix3d enu_from_ecef_;
};

}  // namespace overfly::geo
