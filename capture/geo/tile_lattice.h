#pragma once
#include <Eigen/Core>
#include <compare>
#include <cstdint>
#include <optional>
#include <string>

#include "capture/geo/geodetic.h"
#include "config/error.h"

namespace overfly::geo {

// One cell of the lattice at one zoom. x grows east, y grows south; both may have any sign (x is unwrapped
// on the Web Mercator lattice; see TileLattice::wrapped).
struct TileKey {
  int zoom = 0;
  std::int64_t x = 0;
  std::int64_t y = 0;
  friend auto operator<=>(const TileKey&, const TileKey&) = default;
};

// Parent and children after (3.1), (3.5): floor division, so that negative indices group as they should.
[[nodiscard]] TileKey parentOf(const TileKey& key);
// Child i of 0..3: bit 0 is +x (east), bit 1 is +y (south).
[[nodiscard]] TileKey childOf(const TileKey& key, int i);

enum class LatticeKind { WebMercator, Utm, Ups, Local };

// The grid that tiles the Earth. Plane coordinates (px, py) are in units of whole cells at zoom 0, px
// east, py SOUTH; a cell at zoom z is 2^-z of that. For Web Mercator zoom 0 is the whole world, (0,0) its
// north-west corner: keys are XYZ tiles. For Utm, Ups and Local a zoom-0 cell has the same nominal
// side, 2*pi*6378137 m, and (0,0) is the chosen origin, so that zooms mean the same resolution everywhere.
// Value type, reentrant.
class TileLattice {
 public:
  [[nodiscard]] static TileLattice webMercator();
  // Zone 1..60; origin of the index grid at the zone's (500 km, equator) false origin.
  [[nodiscard]] static Result<TileLattice> utm(int zone, bool north);
  [[nodiscard]] static TileLattice ups(bool north);
  // Azimuthal equidistant around `origin` (GeographicLib), good to some hundred kilometres.
  [[nodiscard]] static TileLattice local(const Geodetic& origin);

  // "webmercator", "utm:33N", "ups:N", "local:LAT,LON" (degrees); the store keeps this text.
  [[nodiscard]] static Result<TileLattice> parse(const std::string& text);
  [[nodiscard]] std::string text() const;
  [[nodiscard]] LatticeKind kind() const { return kind_; }

  // Plane coordinates of a point; nullopt outside the projection's domain (Web Mercator beyond 85.06 deg).
  // Web Mercator: px continues across the antimeridian towards `near_px` (the copy of the world that is
  // nearest to it), so that one flight has one unwrapped range.
  [[nodiscard]] std::optional<Eigen::Vector2d> planeFromGeodetic(double lat, double lon,
                                                                 double near_px = 0.5) const;
  // Latitude and longitude (radians, lon in [-pi, pi]) of plane coordinates; height 0.
  [[nodiscard]] Geodetic geodeticFromPlane(const Eigen::Vector2d& plane) const;

  [[nodiscard]] static TileKey keyAt(const Eigen::Vector2d& plane, int zoom);
  // North-west corner of a cell in plane coordinates; fractional x, y in cells are added.
  [[nodiscard]] static Eigen::Vector2d planeOf(const TileKey& key, double fx = 0, double fy = 0);
  // x wrapped into [0, 2^zoom) for Web Mercator, unchanged otherwise: what the link and the store's XYZ see.
  [[nodiscard]] TileKey wrapped(const TileKey& key) const;

  // Ground length in metres of one plane unit (a zoom-0 cell) at a place, mean of east and north.
  [[nodiscard]] double metresPerPlaneUnit(double lat, double lon) const;
  // The zoom whose texel (cell / tile_size) is nearest, in log2, to a ground sampling distance there.
  [[nodiscard]] int zoomForGsd(double gsd_m, double lat, double lon, int tile_size) const;
  [[nodiscard]] double texelSize(int zoom, double lat, double lon, int tile_size) const;

  friend bool operator==(const TileLattice&, const TileLattice&) = default;

 private:
  LatticeKind kind_ = LatticeKind::WebMercator;
  int zone_ = 0;
  bool north_ = true;
  double origin_lat_ = 0, origin_lon_ = 0;
};

}  // namespace overfly::geo
