#include "capture/geo/tile_frame.h"

#include <Eigen/QR>
#include <cmath>
#include <limits>

namespace overfly::geo {
namespace {

constexpr int kNodes = 7;           // per axis; more than the degree, so that the fit also smooths rounding
constexpr double kHalfRange = 2.0;  // s, t in [-2, 2]: the tile and its apron

constexpr int kGroundTerms = TileFrame::kGroundTerms;
constexpr int kUpTerms = TileFrame::kUpTerms;
static_assert(TileFrame::kUpDegree <= TileFrame::kGroundDegree);

// 1, s, t, s^2, st, t^2, ... up to kGroundDegree; a lower degree is a prefix of it.
Eigen::Matrix<double, 1, kGroundTerms> monomials(double s, double t) {
  Eigen::Matrix<double, 1, kGroundTerms> row;
  row[0] = 1;
  int begin = 0;  // of the terms of the previous degree
  for (int degree = 1, next = 1; degree <= TileFrame::kGroundDegree; ++degree) {
    for (int i = 0; i < degree; ++i) row[next + i] = row[begin + i] * s;
    row[next + degree] = row[begin + degree - 1] * t;
    begin = next;
    next += degree + 1;
  }
  return row;
}

// The nodes, and the matrices that turn values at the nodes into least-squares coefficients.
struct Fit {
  std::array<double, kNodes> node;  // in s or t
  Eigen::Matrix<double, kGroundTerms, kNodes * kNodes> ground;
  Eigen::Matrix<double, kUpTerms, kNodes * kNodes> up;

  Fit() {
    Eigen::MatrixXd basis(kNodes * kNodes, kGroundTerms);
    for (int i = 0; i < kNodes; ++i)
      node[static_cast<std::size_t>(i)] =
          kHalfRange * std::cos((2 * i + 1) * 3.14159265358979323846 / (2 * kNodes));
    for (int i = 0; i < kNodes * kNodes; ++i) basis.row(i) = monomials(s(i), t(i));
    ground = basis.completeOrthogonalDecomposition().pseudoInverse();
    up = basis.leftCols<kUpTerms>().completeOrthogonalDecomposition().pseudoInverse();
  }
  [[nodiscard]] double s(int i) const { return node[static_cast<std::size_t>(i % kNodes)]; }
  [[nodiscard]] double t(int i) const { return node[static_cast<std::size_t>(i / kNodes)]; }
};

Geodetic onEllipsoid(const TileLattice& lattice, const TileKey& key, double u, double v) {
  return lattice.geodeticFromPlane(TileLattice::planeOf(key, u, v));
}

}  // namespace

TileFrame::TileFrame(const TileLattice& lattice, const TileKey& key)
    : lattice_(lattice), key_(key), local_(onEllipsoid(lattice, key, 0.5, 0.5)) {
  static const Fit fit;
  Eigen::Matrix<double, kNodes * kNodes, 3> ground_at, up_at;
  for (int i = 0; i < kNodes * kNodes; ++i) {
    const Geodetic at = onEllipsoid(lattice_, key_, 0.5 * (fit.s(i) + 1), 0.5 * (fit.t(i) + 1));
    ground_at.row(i) = local_.enuFromEcef(ecefFromGeodetic(at));
    up_at.row(i) = local_.enuFromEcefRotation() * upInEcef(at.lat, at.lon);
  }
  const Eigen::Matrix<double, kGroundTerms, 3> ground = fit.ground * ground_at;
  const Eigen::Matrix<double, kUpTerms, 3> up = fit.up * up_at;
  for (int i = 0; i < kGroundTerms; ++i) ground_[static_cast<std::size_t>(i)] = ground.row(i);
  for (int i = 0; i < kUpTerms; ++i) up_[static_cast<std::size_t>(i)] = up.row(i);
}

Eigen::Vector3d TileFrame::enuFromTexelExact(double u, double v, double h) const {
  Geodetic at = onEllipsoid(lattice_, key_, u, v);
  at.height_m = h;
  return local_.enuFromEcef(ecefFromGeodetic(at));
}

Eigen::Vector3d TileFrame::enuFromTexel(double u, double v, double h) const {
  const auto row = monomials(2 * u - 1, 2 * v - 1);
  Eigen::Vector3d ground = Eigen::Vector3d::Zero(), up = Eigen::Vector3d::Zero();
  for (int i = 0; i < kGroundTerms; ++i) ground += row[i] * ground_[static_cast<std::size_t>(i)];
  for (int i = 0; i < kUpTerms; ++i) up += row[i] * up_[static_cast<std::size_t>(i)];
  return ground + h * up;
}

Eigen::Vector3d TileFrame::texelFromEnu(const Eigen::Vector3d& point_in_tile) const {
  const Geodetic at = geodeticFromEcef(local_.ecefFromEnu(point_in_tile));
  const double near_px = TileLattice::planeOf(key_, 0.5, 0.5).x();
  const auto plane = lattice_.planeFromGeodetic(at.lat, at.lon, near_px);
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  if (!plane) return {kNan, kNan, at.height_m};
  return {std::ldexp(plane->x(), key_.zoom) - static_cast<double>(key_.x),
          std::ldexp(plane->y(), key_.zoom) - static_cast<double>(key_.y), at.height_m};
}

}  // namespace overfly::geo
