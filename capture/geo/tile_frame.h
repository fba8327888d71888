#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>

#include "capture/geo/geodetic.h"
#include "capture/geo/tile_lattice.h"

namespace overfly::geo {

// Terms of a polynomial in two variables of that total degree.
[[nodiscard]] constexpr int polynomialTerms(int degree) { return (degree + 1) * (degree + 2) / 2; }

// The East-North-Up frame of one tile, at the tile's centre on the ellipsoid, and the map from texels into
// it. Everything the GPU sees of a tile is in this frame, in metres, computed in double here.
//
// Texel coordinates: (u, v) in [0, 1]^2 over the tile, u east, v south, (0, 0) the north-west corner; values
// in [-0.5, 1.5] are valid too (the apron). Height h is ellipsoidal, in metres. The map is exactly linear in
// h at fixed (u, v):   p(u, v, h) = ground(u, v) + h * up(u, v)   (metres, tile ENU).
class TileFrame {
 public:
  TileFrame(const TileLattice& lattice, const TileKey& key);

  [[nodiscard]] const TileKey& key() const { return key_; }
  [[nodiscard]] const LocalFrame& local() const { return local_; }

  // Exact, through the lattice's inverse projection (slow: GeographicLib).
  [[nodiscard]] Eigen::Vector3d enuFromTexelExact(double u, double v, double h) const;

  // Polynomials in s = 2u-1, t = 2v-1: coefficient order 1, s, t, s^2, st, t^2, s^3, s^2 t, s t^2, t^3, ...
  // (total degree kGroundDegree for ground, kUpDegree for up). Within 0.1 mm of the exact map for zooms
  // 10..28, heights -500..9000 m, (u, v) in [-0.5, 1.5]^2, the apron included (test: TileFrameProperty).
  // Fitted by least squares at Chebyshev nodes over that range.
  static constexpr int kGroundDegree = 5;
  static constexpr int kUpDegree = 4;
  static constexpr int kGroundTerms = polynomialTerms(kGroundDegree);
  static constexpr int kUpTerms = polynomialTerms(kUpDegree);
  [[nodiscard]] const std::array<Eigen::Vector3d, kGroundTerms>& ground() const { return ground_; }
  [[nodiscard]] const std::array<Eigen::Vector3d, kUpTerms>& up() const { return up_; }
  [[nodiscard]] Eigen::Vector3d enuFromTexel(double u, double v, double h) const;

  // Texel coordinates and height of a point in the tile's ENU frame (inverse of the above; exact path).
  // NaN u, v where the point lies outside the lattice's domain.
  [[nodiscard]] Eigen::Vector3d texelFromEnu(const Eigen::Vector3d& point_in_tile) const;

 private:
  TileLattice lattice_;
  TileKey key_;
  LocalFrame local_;
  std::array<Eigen::Vector3d, kGroundTerms> ground_;
  std::array<Eigen::Vector3d, kUpTerms> up_;
};

}  // namespace overfly::geo
