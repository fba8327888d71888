#pragma once
#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "capture/geo/tile_frame.h"
#include "render/gl/program.h"
#include "tiling/sweep/sweep.h"

namespace overfly::tiling {

// The views of a cell in the cell's own frame, narrowed to float for the GPU: texel_rays.glsl's uniforms.
struct ViewGeometry {
  double reference_height_m = 0;           // heights on the GPU count from here
  double height_per_baseline = 1;          // mean camera height over mean distance of two cameras
  double gsd_m = 0;                        // median over the views, on the ground below them
  std::vector<double> view_gsd_m;          // of each view
  std::vector<Eigen::Vector3f> camera;     // of each view, in tile ENU
  std::vector<Eigen::Vector4f> matrix;     // 3 rows a view: texture coordinates (homogeneous) from tile ENU
  std::array<Eigen::Vector3f, 10> ground;  // TileFrame's polynomials, to degree 3 and at the reference height
  std::array<Eigen::Vector3f, 6> up;       // and 2: below 0.1 mm from the whole at zoom 14 and finer
};

[[nodiscard]] ViewGeometry viewGeometry(std::span<const SweepView> views, const geo::TileFrame& frame,
                                        double ground_height_m, double reference_height_m);

// The number of views as shaders want it: VIEWS; EACH_VIEW(F), which is F(0) F(1) ... F(VIEWS - 1);
// EACH_PAIR(F), which is F(1, 0) F(2, 0) F(2, 1) ... F(VIEWS - 1, VIEWS - 2).
[[nodiscard]] std::vector<gl::Define> viewDefines(int views);

// Sets where a grid of texels x texels over the cell lies, with `apron` more of its texels on every side.
void setGrid(gl::Program& program, const ViewGeometry& geometry, int texels, int apron);
// Sets the rays of a grid of texels x texels over the cell, with `apron` more of its texels on every side.
// Views without a match image need a texture set by the caller.
void setRays(gl::Program& program, const ViewGeometry& geometry, std::span<const SweepView> views, int texels,
             int apron);

}  // namespace overfly::tiling
