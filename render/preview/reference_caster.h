#pragma once
#include <cstdint>
#include <optional>

#include "render/preview/height_grid.h"
#include "render/preview/surface.h"
#include "render/preview/view.h"

namespace overfly::preview {

struct ReferenceHit {
  double t = 0;                 // metres along the ray
  Eigen::Vector2d texel{0, 0};  // level-0 texels from the domain's corner
  double height_m = 0;
};

// What the GPU is measured against: every cell of one level that a ray crosses, one after the other, in
// double; no bounds, no levels, no pyramid; the ray's curve in chords of 10 m (0.002 mm off); the surface met
// by sampling it 64 times over each cell and halving the interval where its sign changes. Slow on purpose.
// A ray that enters a cell below its surface hits there (a wall), as does one that starts below it; one that
// enters a cell downwards kWallFoot below all else ends.
class ReferenceCaster {
 public:
  // The grid is of level 0 and covers the domain.
  ReferenceCaster(const HeightGrid& grid, Surface surface);

  // The ray from the frame's start plus `offset` (texels, texels, metres).
  [[nodiscard]] std::optional<ReferenceHit> cast(
      const RayFrame& frame, const Eigen::Vector3d& direction, double length_m,
      const Eigen::Vector3d& offset = Eigen::Vector3d::Zero()) const;

 private:
  [[nodiscard]] std::optional<double> meet(int x, int y, const Eigen::Vector3d& in,
                                           const Eigen::Vector3d& out) const;
  const HeightGrid& grid_;
  Surface surface_;
  double lowest_ = 0, highest_ = 0;
};

}  // namespace overfly::preview
