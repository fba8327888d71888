#pragma once
#include <cstdint>

#include "capture/camera_model.h"
#include "render/gl/texture.h"

namespace overfly::tiling {

// Brightness and sharpness of the valid pixels; luminance 0..1 after (5.10).
struct LumaStats {
  double mean = 0;
  double deviation = 0;  // standard deviation
  double sharpness = 0;  // root mean square of the 4-neighbour Laplacian; comparable within a flight
  double valid = 0;      // share of the undistorted image that the source covers
};

struct RectifyTimes {
  double decode_s = 0;  // JPEG to pixels, on the CPU
  double upload_s = 0;  // pixels to the GPU
  double gpu_s = 0;     // conversion, undistortion, mips, statistics
};

// A frame as the sweep reads it: a pinhole image on the GPU. Row 0 is the top row; texture coordinates are
// pixels / size, the first pixel's centre at (0.5, 0.5). Thread-bound to its GL context.
struct RectifiedFrame {
  std::uint64_t id = 0;
  capture::CameraModel camera;   // of the distorted source: tells whether a calibration has changed
  capture::CameraModel pinhole;  // of the textures
  gl::Texture color;             // RGBA8, alpha 1 where valid, else 0
  gl::Texture luma;              // R8, full mip chain; beyond the valid area the border goes on
  // RGBA8 with luma's mip levels: (x, y) holds luma at (x, y), (x+1, y), (x, y+1), (x+1, y+1). Only when
  // asked for. One texelFetch and own weights are the fastest bilinear read on software rasterisers.
  gl::Texture quads;
  LumaStats stats;
  RectifyTimes times;

  [[nodiscard]] std::size_t bytes() const { return color.bytes() + luma.bytes() + quads.bytes(); }
};

}  // namespace overfly::tiling
