#pragma once
#include <span>

#include "config/error.h"
#include "tiling/mapping/thumbnail.h"

namespace overfly::tiling {

struct GroundEstimate {
  double height_m = 0;                 // ellipsoidal (or the flight's datum): median over the pairs of frames
  double lowest_m = 0, highest_m = 0;  // of the pairs
  double camera_above_m = 0;           // median height of the cameras above it
  double correlation = 0;              // median of the pairs' best
  int pairs = 0;
};

// Where the ground is below the first frames, from the images alone: for neighbouring frames the horizontal
// plane at which their overlap correlates best, searched in steps of equal parallax, then refined. Needs a
// pose that is good to a few thumbnail pixels. Unavailable when no pair agrees (no overlap, no texture).
[[nodiscard]] Result<GroundEstimate> estimateGround(std::span<const Thumbnail> frames);

}  // namespace overfly::tiling
