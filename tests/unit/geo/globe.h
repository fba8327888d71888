#pragma once
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cmath>

#include "capture/geo/geodetic.h"
#include "capture/geo/tile_lattice.h"

// Random places and lattices for the property tests; RC_PARAMS="max_success=N" lengthens them.
namespace overfly::geo::testing {

// Even over the range from the first case on (RapidCheck's own inRange begins at the low end).
template <typename T>
rc::Gen<T> integer(T low, T end) {
  return rc::gen::resize(rc::kNominalSize, rc::gen::inRange<T>(low, end));
}

inline rc::Gen<double> uniform(double low, double high) {
  constexpr std::int64_t kSteps = std::int64_t{1} << 52;
  return rc::gen::map(integer<std::int64_t>(0, kSteps + 1), [=](std::int64_t k) {
    return low + (high - low) * (static_cast<double>(k) / static_cast<double>(kSteps));
  });
}

// Longitudes in degrees over the globe, often exactly at or a hair beside the antimeridian.
inline rc::Gen<double> longitudeDeg() {
  return rc::gen::oneOf(uniform(-180, 180),
                        rc::gen::element(-180.0, 180.0, 0.0, 179.99999999, -179.99999999));
}

struct Place {
  TileLattice lattice = TileLattice::webMercator();
  double lat = 0, lon = 0;  // radians, in the lattice's domain
};

// A lattice of any kind and a place where it is used: Web Mercator to 85 deg, UTM in and beside its zone, UPS
// beyond 80 deg with the pole itself, local within 100 km of any place with the poles themselves.
inline rc::Gen<Place> place() {
  return rc::gen::exec([] {
    Place p;
    const int kind = *integer(0, 4);
    const double pick = *uniform(0, 1);
    p.lon = radians(*longitudeDeg());
    if (kind == 0) {
      p.lat = radians(*rc::gen::oneOf(uniform(-85, 85), rc::gen::element(-85.0, 85.0, 0.0)));
    } else if (kind == 1) {
      const int zone = *integer(1, 61);
      p.lattice = TileLattice::utm(zone, pick > 0.5).value();
      p.lat = radians(*uniform(-84, 84));
      p.lon = std::remainder(radians(6 * zone - 183 + *uniform(-6, 6)), 2 * 3.14159265358979323846);
    } else if (kind == 2) {
      const bool north = pick > 0.5;
      p.lattice = TileLattice::ups(north);
      p.lat = radians((north ? 1 : -1) * *rc::gen::oneOf(uniform(80, 90), rc::gen::just(90.0)));
    } else {
      const double lat0 = *rc::gen::oneOf(uniform(-90, 90), rc::gen::element(-90.0, 90.0, 89.9999));
      p.lattice = TileLattice::local({radians(lat0), p.lon, 0});
      const double range_m = *uniform(0, 100e3) * pick * pick, azimuth = *uniform(0, 6.28318);
      const LocalFrame around({radians(lat0), p.lon, 0});
      const Geodetic at =
          geodeticFromEcef(around.ecefFromEnu({range_m * std::sin(azimuth), range_m * std::cos(azimuth), 0}));
      p.lat = at.lat;
      p.lon = at.lon;
    }
    return p;
  });
}

// Metres between two places on the ellipsoid (chord).
inline double metresBetween(double lat_a, double lon_a, double lat_b, double lon_b) {
  return (ecefFromGeodetic({lat_a, lon_a, 0}) - ecefFromGeodetic({lat_b, lon_b, 0})).norm();
}

}  // namespace overfly::geo::testing
