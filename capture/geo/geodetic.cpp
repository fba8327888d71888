#include "capture/geo/geodetic.h"

#include <GeographicLib/Geocentric.hpp>
#include <cmath>

namespace overfly::geo {

Eigen::Vector3d ecefFromGeodetic(const Geodetic& point) {
  Eigen::Vector3d ecef;
  GeographicLib::Geocentric::WGS84().Forward(degrees(point.lat), degrees(point.lon), point.height_m, ecef.x(),
                                             ecef.y(), ecef.z());
  return ecef;
}

Geodetic geodeticFromEcef(const Eigen::Vector3d& point_in_ecef) {
  double lat_deg = 0, lon_deg = 0, height_m = 0;
  GeographicLib::Geocentric::WGS84().Reverse(point_in_ecef.x(), point_in_ecef.y(), point_in_ecef.z(), lat_deg,
                                             lon_deg, height_m);
  return {radians(lat_deg), radians(lon_deg), height_m};
}

Eigen::Vector3d upInEcef(double lat, double lon) {
  return {std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat)};
}

LocalFrame::LocalFrame(const Geodetic& origin) : origin_(origin), origin_in_ecef_(ecefFromGeodetic(origin)) {
  const double sin_lon = std::sin(origin.lon), cos_lon = std::cos(origin.lon);
  const Eigen::Vector3d east(-sin_lon, cos_lon, 0);
  const Eigen::Vector3d up = upInEcef(origin.lat, origin.lon);
  enu_from_ecef_.row(0) = east;
  enu_from_ecef_.row(1) = up.cross(east);
  enu_from_ecef_.row(2) = up;
}

}  // namespace overfly::geo
