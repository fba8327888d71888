#pragma once
#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

namespace overfly::capture {

// How a lens maps directions to pixels. Value type; all methods are reentrant.
//
// Pixel convention of the whole project: row 0 at the top, the centre of the first pixel is (0.5, 0.5).
// OpenCV puts it at (0, 0): subtract 0.5 from cx, cy (and from pixels) at OpenCV calls.
// Camera axes: x right, y down, z forward (OpenCV).
class CameraModel {
 public:
  enum class Kind {
    Pinhole,           // no distortion
    RadialTangential,  // OpenCV k1 k2 p1 p2 [k3 [k4 k5 k6]]: 4, 5 or 8 coefficients
    Fisheye,           // OpenCV fisheye (equidistant) k1..k4
  };

  Kind kind = Kind::Pinhole;
  int width = 0;                   // pixels
  int height = 0;                  // pixels
  double fx = 0, fy = 0;           // focal lengths, pixels
  double cx = 0, cy = 0;           // principal point, pixels, first pixel's centre at (0.5, 0.5)
  std::vector<double> distortion;  // in OpenCV's order; empty, 4, 5 or 8 values

  // Pixel of a point given in camera axes (any scale); nullopt where the model is not valid: behind the
  // camera (pinhole, radial-tangential: z <= 0), or beyond the radius where the distortion stops being
  // monotone. The pixel may lie outside the image.
  [[nodiscard]] std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point_in_camera) const;

  // Unit direction in camera axes of a pixel; nullopt outside the model's valid domain.
  [[nodiscard]] std::optional<Eigen::Vector3d> unproject(const Eigen::Vector2d& pixel) const;

  // Radius (tangent of the angle for Pinhole/RadialTangential, angle in radians for Fisheye) up to which
  // the distortion is strictly monotone; infinity for Pinhole.
  [[nodiscard]] double validRadius() const;

  // The same lens for an image scaled by `factor` (0.5: half size).
  [[nodiscard]] CameraModel scaled(double factor) const;

  // nullopt when usable, else one sentence naming the wrong value.
  [[nodiscard]] std::optional<std::string> problem() const;

  friend bool operator==(const CameraModel&, const CameraModel&) = default;
};

}  // namespace overfly::capture
