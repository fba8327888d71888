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
  // Zone 1..60; (0, 0) is where the central meridian meets the equator (easting 500 km), on both hemispheres;
  // `north` only says which of the zone's two names is meant. Domain: 3,500 km to each side.
  [[nodiscard]] static Result<TileLattice> utm(int zone, bool north);
  // (0, 0) is the pole, plane north is along longitude 180 (N) or 0 (S). Domain: latitudes beyond 60 deg.
  [[nodiscard]] static TileLattice ups(bool north);
  // Azimuthal equidistant around `origin` (height ignored), valid at any place of the Earth, poles included.
  // Off by r^2 / 6R^2 in scale across the radius: 4e-4 at 300 km. Domain: 2,000 km around the origin.
  [[nodiscard]] static TileLattice local(const Geodetic& origin);

  // "webmercator", "utm:33N", "ups:N", "local:LAT,LON" (degrees); the store keeps this text.
  [[nodiscard]] static Result<TileLattice> parse(const std::string& text);
  [[nodiscard]] std::string text() const;
  [[nodiscard]] LatticeKind kind() const { return kind_; }
  // Utm: the zone, else 0. Utm and Ups: the hemisphere.
  [[nodiscard]] int zone() const { return zone_; }
  [[nodiscard]] bool north() const { return north_; }

  // Plane coordinates of a point; nullopt outside the projection's domain (Web Mercator: |latitude| beyond
  // 85.0511 deg, where the square world ends) and for a NaN. Web Mercator is the spherical formula on
  // geodetic latitude (EPSG:3857).
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
  // Zoom-0 cell of the non-global kinds in projected metres; the equator's length for Web Mercator.
  static constexpr double kCellMetres = 2 * 3.14159265358979323846 * 6378137.0;
  // The zoom whose texel (cell / tile_size) is nearest, in log2, to a ground sampling distance there.
  [[nodiscard]] int zoomForGsd(double gsd_m, double lat, double lon, int tile_size) const;
  [[nodiscard]] double texelSize(int zoom, double lat, double lon, int tile_size) const;

  friend bool operator==(const TileLattice&, const TileLattice&) = default;

 private:
  LatticeKind kind_ = LatticeKind::WebMercator;
  int zone_ = 0;
  bool north_ = true;
  double origin_lat_deg_ = 0, origin_lon_deg_ = 0;  // degrees, so that text() reads back bit for bit
};

}  // namespace overfly::geo
