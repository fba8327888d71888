#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "capture/camera_model.h"
#include "config/error.h"

namespace overfly::tiling {

struct UndistortionOptions {
  // The undistorted image keeps the lens's focal length (so the resolution at its centre) and grows to hold
  // the whole source, but at most to this multiple of the source's extent from the principal point: a wide
  // fisheye's rim, stretched without end by a pinhole, is cut off.
  double max_growth = 1.5;
  // Both sides are rounded up to this multiple, so that mip levels up to log2 of it divide evenly and their
  // texels lie exactly on blocks of level 0. What is added is invalid.
  int align = 16;
  // Longest side, pixels: the device's texture limit. Beyond it the focal length is reduced.
  int max_side = 16384;
  // Largest distance, in source pixels, between the interpolated map and the exact one. Smaller: finer grid.
  double tolerance_px = 0.004;
};

// From the pixels of an ideal pinhole image to those of the camera's own, as a grid of displacements that
// is interpolated bilinearly. Computed in double from CameraModel; plain data, reentrant.
struct Undistortion {
  capture::CameraModel pinhole;  // of the undistorted image; without distortion
  int step = 16;                 // pinhole pixels between nodes; node (0, 0) lies on the image's corner
  int nodes_x = 0, nodes_y = 0;
  // Source pixel minus pinhole pixel at each node, x then y, row by row. kNowhere in both where the camera
  // model has no answer: a cell with such a node is invalid.
  std::vector<float> shift;
  static constexpr float kNowhere = 1e9F;

  // Interpolated as the shader does it, in double; nullopt in an invalid cell or outside the image.
  [[nodiscard]] std::optional<Eigen::Vector2d> sourceFromPinhole(const Eigen::Vector2d& pixel) const;
};

// The exact map; nullopt where the camera model has no answer.
[[nodiscard]] std::optional<Eigen::Vector2d> exactSourceFromPinhole(const capture::CameraModel& source,
                                                                    const capture::CameraModel& pinhole,
                                                                    const Eigen::Vector2d& pixel);

// BadInput when the camera model is unusable.
[[nodiscard]] Result<Undistortion> planUndistortion(const capture::CameraModel& source,
                                                    const UndistortionOptions& options = {});

}  // namespace overfly::tiling
