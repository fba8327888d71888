#include "capture/geo/geodetic.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <GeographicLib/LocalCartesian.hpp>

#include "tests/unit/geo/globe.h"

namespace overfly::geo {
namespace {

using testing::longitudeDeg;
using testing::uniform;

RC_GTEST_PROP(GeodeticProperty, ecefRoundTripWithinTwentyNanometres, ()) {
  const Geodetic p{radians(*rc::gen::oneOf(uniform(-90, 90), rc::gen::element(-90.0, 90.0))),
                   radians(*longitudeDeg()), *uniform(-500, 20000)};
  const Eigen::Vector3d ecef = ecefFromGeodetic(p);
  const Geodetic back = geodeticFromEcef(ecef);
  RC_ASSERT((ecefFromGeodetic(back) - ecef).norm() < 2e-8);
  RC_ASSERT(std::abs(back.height_m - p.height_m) < 1e-8);
  RC_ASSERT((ecefFromGeodetic({p.lat, p.lon, p.height_m + 1}) - ecef - upInEcef(p.lat, p.lon)).norm() < 1e-8);
}

RC_GTEST_PROP(GeodeticProperty, localFrameIsGeographicLibsLocalCartesian, ()) {
  const double lat = *rc::gen::oneOf(uniform(-90, 90), rc::gen::element(-90.0, 90.0)), lon = *longitudeDeg();
  const double h = *uniform(-500, 9000);
  const LocalFrame local({radians(lat), radians(lon), h});
  const GeographicLib::LocalCartesian reference(lat, lon, h);
  const double lat_b = std::clamp(lat + *uniform(-1, 1), -90.0, 90.0), lon_b = lon + *uniform(-1, 1);
  Eigen::Vector3d expected;
  reference.Forward(lat_b, lon_b, 77, expected.x(), expected.y(), expected.z());
  const Eigen::Vector3d ecef = ecefFromGeodetic({radians(lat_b), radians(lon_b), 77});
  RC_ASSERT((local.enuFromEcef(ecef) - expected).norm() < 2e-8);
  RC_ASSERT((local.ecefFromEnu(local.enuFromEcef(ecef)) - ecef).norm() < 2e-8);
}

}  // namespace
}  // namespace overfly::geo
