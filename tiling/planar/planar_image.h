#pragma once
#include <cstdint>
#include <memory>
#include <vector>

#include "capture/camera_model.h"
#include "capture/frame.h"
#include "config/error.h"

namespace overfly::tiling {

// A frame's pixels, ready to be sampled on the CPU: four bytes a pixel (R, G, B, unused), rows without gaps.
struct PlanarImage {
  capture::CameraModel camera;  // of these pixels, distortion included
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgbx;
  [[nodiscard]] std::size_t bytes() const { return rgbx.size(); }
};
using PlanarImagePtr = std::shared_ptr<const PlanarImage>;

// Decodes a frame, reduced by the largest of 1, 2, 4, 8 at which a pixel still shows no more ground than a
// texel, so that a bilinear read neither loses detail nor skips much. `gsd_m`: of the full picture.
// `reuse`: memory for the pixels, of an image that is no longer needed.
// BadInput: no picture of the camera's size. Reentrant.
[[nodiscard]] Result<PlanarImage> decodeForPlane(const capture::Frame& frame, double gsd_m, double texel_m,
                                                 std::vector<std::uint8_t>&& reuse = {});

}  // namespace overfly::tiling
