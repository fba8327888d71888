#include "capture/geo/tile_lattice.h"

#include <fmt/format.h>

#include <GeographicLib/AzimuthalEquidistant.hpp>
#include <GeographicLib/PolarStereographic.hpp>
#include <GeographicLib/TransverseMercator.hpp>
#include <charconv>
#include <cmath>
#include <string_view>

namespace overfly::geo {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kUtmHalfWidth_m = 3.5e6;  // GeographicLib's series is good to 5 nm within 3,900 km
constexpr double kUpsMinLatitude_deg = 60;
constexpr double kLocalRadius_m = 2.0e6;

const GeographicLib::AzimuthalEquidistant& azimuthal() {
  static const GeographicLib::AzimuthalEquidistant projection(GeographicLib::Geodesic::WGS84());
  return projection;
}

double centralMeridianDeg(int zone) { return 6.0 * zone - 183.0; }

std::optional<double> number(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

tl::unexpected<Error> badText(const std::string& text) {
  return fail(ErrorCode::BadInput, fmt::format("\"{}\" is no lattice: use webmercator, utm:33N, ups:S or "
                                               "local:LATITUDE,LONGITUDE (degrees)",
                                               text));
}

}  // namespace

TileKey parentOf(const TileKey& key) {
  return {key.zoom - 1, key.x >> 1, key.y >> 1};  // an arithmetic shift is floor(n / 2) in C++20
}

TileKey childOf(const TileKey& key, int i) {
  return {key.zoom + 1, 2 * key.x + (i & 1), 2 * key.y + ((i >> 1) & 1)};
}

TileLattice TileLattice::webMercator() { return {}; }

Result<TileLattice> TileLattice::utm(int zone, bool north) {
  if (zone < 1 || zone > 60)
    return fail(ErrorCode::BadInput, fmt::format("UTM zone {} is not in 1..60", zone));
  TileLattice lattice;
  lattice.kind_ = LatticeKind::Utm;
  lattice.zone_ = zone;
  lattice.north_ = north;
  return lattice;
}

TileLattice TileLattice::ups(bool north) {
  TileLattice lattice;
  lattice.kind_ = LatticeKind::Ups;
  lattice.north_ = north;
  return lattice;
}

TileLattice TileLattice::local(const Geodetic& origin) {
  TileLattice lattice;
  lattice.kind_ = LatticeKind::Local;
  lattice.origin_lat_deg_ = degrees(origin.lat);
  lattice.origin_lon_deg_ = degrees(origin.lon);
  return lattice;
}

Result<TileLattice> TileLattice::parse(const std::string& text) {
  const std::string_view all = text;
  if (all == "webmercator") return webMercator();
  if (all == "ups:N" || all == "ups:S") return ups(all.back() == 'N');
  if (all.starts_with("utm:") && (all.back() == 'N' || all.back() == 'S')) {
    const auto zone = number(all.substr(4, all.size() - 5));
    if (!zone || *zone != std::floor(*zone) || std::abs(*zone) > 99) return badText(text);
    return utm(static_cast<int>(*zone), all.back() == 'N');
  }
  if (all.starts_with("local:")) {
    const auto comma = all.find(',');
    if (comma == std::string_view::npos) return badText(text);
    const auto lat = number(all.substr(6, comma - 6));
    const auto lon = number(all.substr(comma + 1));
    if (!lat || !lon || std::abs(*lat) > 90 || std::abs(*lon) > 180) return badText(text);
    TileLattice lattice;
    lattice.kind_ = LatticeKind::Local;
    lattice.origin_lat_deg_ = *lat;
    lattice.origin_lon_deg_ = *lon;
    return lattice;
  }
  return badText(text);
}

std::string TileLattice::text() const {
  switch (kind_) {
    case LatticeKind::Utm:
      return fmt::format("utm:{}{}", zone_, north_ ? 'N' : 'S');
    case LatticeKind::Ups:
      return north_ ? "ups:N" : "ups:S";
    case LatticeKind::Local:
      return fmt::format("local:{},{}", origin_lat_deg_, origin_lon_deg_);
    case LatticeKind::WebMercator:
      break;
  }
  return "webmercator";
}

std::optional<Eigen::Vector2d> TileLattice::planeFromGeodetic(double lat, double lon, double near_px) const {
  if (!std::isfinite(lat) || !std::isfinite(lon)) return std::nullopt;
  double x = 0, y = 0, convergence = 0, scale = 0;
  switch (kind_) {
    case LatticeKind::WebMercator: {
      const double py = 0.5 - std::asinh(std::tan(lat)) / (2 * kPi);
      if (!(py >= 0 && py <= 1)) return std::nullopt;
      const double px = 0.5 + lon / (2 * kPi);
      return Eigen::Vector2d(px + std::round(near_px - px), py);
    }
    case LatticeKind::Utm: {
      const double lon0 = centralMeridianDeg(zone_);
      if (std::cos(lon - radians(lon0)) <= 0) return std::nullopt;
      GeographicLib::TransverseMercator::UTM().Forward(lon0, degrees(lat), degrees(lon), x, y, convergence,
                                                       scale);
      if (!(std::abs(x) <= kUtmHalfWidth_m)) return std::nullopt;
      break;
    }
    case LatticeKind::Ups:
      if ((north_ ? degrees(lat) : -degrees(lat)) < kUpsMinLatitude_deg) return std::nullopt;
      GeographicLib::PolarStereographic::UPS().Forward(north_, degrees(lat), degrees(lon), x, y, convergence,
                                                       scale);
      break;
    case LatticeKind::Local:
      azimuthal().Forward(origin_lat_deg_, origin_lon_deg_, degrees(lat), degrees(lon), x, y, convergence,
                          scale);
      if (!(std::hypot(x, y) <= kLocalRadius_m)) return std::nullopt;
      break;
  }
  return Eigen::Vector2d(x / kCellMetres, -y / kCellMetres);
}

Geodetic TileLattice::geodeticFromPlane(const Eigen::Vector2d& plane) const {
  const double x = plane.x() * kCellMetres, y = -plane.y() * kCellMetres;
  double lat_deg = 0, lon_deg = 0, convergence = 0, scale = 0;
  switch (kind_) {
    case LatticeKind::WebMercator:
      return {std::atan(std::sinh(kPi * (1 - 2 * plane.y()))),
              2 * kPi * (plane.x() - std::floor(plane.x()) - 0.5), 0};
    case LatticeKind::Utm:
      GeographicLib::TransverseMercator::UTM().Reverse(centralMeridianDeg(zone_), x, y, lat_deg, lon_deg,
                                                       convergence, scale);
      break;
    case LatticeKind::Ups:
      GeographicLib::PolarStereographic::UPS().Reverse(north_, x, y, lat_deg, lon_deg, convergence, scale);
      break;
    case LatticeKind::Local:
      azimuthal().Reverse(origin_lat_deg_, origin_lon_deg_, x, y, lat_deg, lon_deg, convergence, scale);
      break;
  }
  return {radians(lat_deg), radians(lon_deg), 0};
}

TileKey TileLattice::keyAt(const Eigen::Vector2d& plane, int zoom) {
  return {zoom, static_cast<std::int64_t>(std::floor(std::ldexp(plane.x(), zoom))),
          static_cast<std::int64_t>(std::floor(std::ldexp(plane.y(), zoom)))};
}

Eigen::Vector2d TileLattice::planeOf(const TileKey& key, double fx, double fy) {
  return {std::ldexp(static_cast<double>(key.x) + fx, -key.zoom),
          std::ldexp(static_cast<double>(key.y) + fy, -key.zoom)};
}

TileKey TileLattice::wrapped(const TileKey& key) const {
  if (kind_ != LatticeKind::WebMercator || key.zoom > 62) return key;
  const std::int64_t cells = key.zoom > 0 ? std::int64_t{1} << key.zoom : 1;
  return {key.zoom, key.x & (cells - 1), key.y};  // cells is a power of two: the mask is the floored modulus
}

double TileLattice::metresPerPlaneUnit(double lat, double lon) const {
  constexpr double kA = 6378137.0, kF = 1 / 298.257223563, kE2 = kF * (2 - kF);
  double x = 0, y = 0, convergence = 0, scale = 1;
  switch (kind_) {
    case LatticeKind::WebMercator: {
      const double w2 = 1 - kE2 * std::sin(lat) * std::sin(lat);
      const double prime_vertical = kA / std::sqrt(w2), meridional = kA * (1 - kE2) / (w2 * std::sqrt(w2));
      return 2 * kPi * std::cos(lat) * 0.5 * (prime_vertical + meridional);
    }
    case LatticeKind::Utm:
      GeographicLib::TransverseMercator::UTM().Forward(centralMeridianDeg(zone_), degrees(lat), degrees(lon),
                                                       x, y, convergence, scale);
      return kCellMetres / scale;
    case LatticeKind::Ups:
      GeographicLib::PolarStereographic::UPS().Forward(north_, degrees(lat), degrees(lon), x, y, convergence,
                                                       scale);
      return kCellMetres / scale;
    case LatticeKind::Local:
      azimuthal().Forward(origin_lat_deg_, origin_lon_deg_, degrees(lat), degrees(lon), x, y, convergence,
                          scale);
      return kCellMetres * 0.5 *
             (1 + scale);  // radial scale 1; here `scale` is the azimuthal one's reciprocal
  }
  return kCellMetres;
}

int TileLattice::zoomForGsd(double gsd_m, double lat, double lon, int tile_size) const {
  return static_cast<int>(std::lround(std::log2(metresPerPlaneUnit(lat, lon) / (tile_size * gsd_m))));
}

double TileLattice::texelSize(int zoom, double lat, double lon, int tile_size) const {
  return std::ldexp(metresPerPlaneUnit(lat, lon), -zoom) / tile_size;
}

}  // namespace overfly::geo
