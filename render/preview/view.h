#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>

#include "capture/geo/geodetic.h"
#include "config/error.h"
#include "render/preview/domain.h"

namespace overfly::preview {

// The camera that the operator imagines: a pinhole.
struct View {
  geo::Geodetic position;  // height in the map's datum, metres
  double heading = 0;      // of the view direction, from north towards east, radians
  double pitch = -0.5;     // above the horizon, radians: -pi/2 looks straight down (the heading is then up)
  double fov = 1.0471975512;  // across the picture's width, radians, in (0, pi)
  int width = 1280, height = 720;

  [[nodiscard]] double focal() const;  // pixels
  // Camera (x right, y down, z ahead) to East-North-Up at the position.
  [[nodiscard]] Eigen::Matrix3d enuFromCamera() const;
  // Unit direction, East-North-Up, through image point (x, y); the first pixel's centre is (0.5, 0.5).
  [[nodiscard]] Eigen::Vector3d direction(double x, double y) const;
};

// How a straight line through the air runs in the map's own coordinates (texels east, texels south of the
// finest level, metres of height): the lattice bends and scales it. To second order in the distance t,
//
//   q(t) = start + t J d + t^2 B(d, d)
//
// with d the unit direction in East-North-Up at the camera. The third order, left out, grows with the cube of
// the distance: at 10 km 2 cm up to 48 degrees of latitude, 7 cm at 70 (test: RayFrame). Positions are from
// `cell`, the finest texel below the camera: narrowing to float costs a fixed part of the distance from the
// camera and nothing for the distance from any origin.
struct RayFrame {
  Eigen::Vector2i cell{0, 0};           // from the domain's corner; may lie outside the domain
  Eigen::Vector3d start{0, 0, 0};       // x, y in [0, 1) within `cell`; height above `base_height_m`
  double base_height_m = 0;             // what heights count from
  Eigen::Matrix3d per_metre;            // J
  std::array<Eigen::Matrix3d, 3> bend;  // B: symmetric, one per coordinate

  // BadInput: the position lies outside the lattice, or absurdly far from the map.
  [[nodiscard]] static Result<RayFrame> create(const Domain& domain, const geo::Geodetic& position,
                                               double base_height_m);
  [[nodiscard]] Eigen::Vector3d at(const Eigen::Vector3d& direction, double t) const {
    return start + t * (per_metre * direction) +
           t * t *
               Eigen::Vector3d(direction.dot(bend[0] * direction), direction.dot(bend[1] * direction),
                               direction.dot(bend[2] * direction));
  }
};

// Rays are cast along chords of that curve: one that begins at distance t is max(metres, growth t) long. It
// lies beside the curve by an eighth of the curvature (about 1 over the Earth's radius) times its length
// squared.
struct Chords {
  double metres, growth;
};
// 0.05 mm off to 5 km, 0.2 mm at 10 km.
inline constexpr Chords kExactChords{50, 0.01};
// 2 mm off to 2 km, 1.6 m at 60 km: 0.03 of a pixel that is a thousandth of the distance.
inline constexpr Chords kPictureChords{300, 0.15};
// How far below the map's lowest height the walls of its edges and holes reach, metres: a ray that enters a
// cell downwards below that ends.
inline constexpr double kWallFoot = 1;

}  // namespace overfly::preview
