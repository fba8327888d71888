#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "capture/camera_model.h"
#include "capture/geo/geodetic.h"
#include "capture/pose.h"

namespace overfly::tiling {

// A frame's luminance at a fraction of its size, on the CPU: enough to find the ground below it and to
// compare exposures.
struct Thumbnail {
  std::uint64_t frame_id = 0;
  capture::CameraModel camera;  // Pinhole, of the thumbnail
  capture::Pose pose;
  std::vector<std::uint8_t> luma;  // coded, row by row

  // 0..1, bilinear; nullopt outside.
  [[nodiscard]] std::optional<float> at(const Eigen::Vector2d& pixel) const;
  // Half the size; an odd row or column at the end is left out.
  [[nodiscard]] Thumbnail halved() const;
};

// Seen from frame `from`: luminance pairs (0..1) of the same ground points in two thumbnails, on the surface
// of the given ellipsoidal height (taken for a plane below the first camera), every `stride`-th pixel.
struct LumaPairs {
  std::vector<float> a, b;
  std::size_t tried = 0;  // pixels of the first thumbnail
};
[[nodiscard]] LumaPairs pairsOnGround(const Thumbnail& from, const Thumbnail& to, double ground_height_m,
                                      int stride);

}  // namespace overfly::tiling
