#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "capture/camera_model.h"
#include "render/scene/flight_path.h"
#include "render/scene/mesh.h"

namespace overfly::scene {

// The pinhole that a picture is rasterised through, pixels; the sensor's own, or a wider one from which lens
// distortion is resampled.
struct RenderCamera {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;
};

// What one frame is rendered from.
struct View {
  RenderCamera camera;
  CameraState state;    // at the middle of the exposure
  CameraMotion motion;  // in camera axes
  double time_s = 0;    // from the flight's start
  double near_m = 0.5, far_m = 1000;

  // Whether a box may be in the picture, with `margin` times the picture added on every side.
  [[nodiscard]] bool sees(const Eigen::AlignedBox3f& box, double margin) const;
  // Depths along the camera's axis of a box, least and greatest.
  [[nodiscard]] std::pair<double, double> depthsOf(const Eigen::AlignedBox3f& box) const;
};

// A run of indices to draw.
struct IndexRun {
  int first = 0;
  int count = 0;
};

// Runs of the chunks that `wanted` accepts, neighbours joined.
template <typename Wanted>
std::vector<IndexRun> runsOf(const Mesh& mesh, const Wanted& wanted) {
  std::vector<IndexRun> runs;
  for (const Chunk& chunk : mesh.chunks) {
    if (!wanted(chunk.box)) continue;
    const int first = static_cast<int>(chunk.first), count = static_cast<int>(chunk.count);
    if (!runs.empty() && runs.back().first + runs.back().count == first) {
      runs.back().count += count;
    } else {
      runs.push_back({first, count});
    }
  }
  return runs;
}

}  // namespace overfly::scene
