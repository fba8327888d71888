#pragma once
#include "capture/live_camera_options.h"
#include "capture/pixel_layout.h"
#include "capture/v4l2/detail/node.h"

namespace overfly::capture::v4l2 {

// How the camera will give its pictures.
struct Mode {
  PixelLayout layout;
  int width = 0, height = 0;
  int stride = 0;              // bytes per row of the first plane
  bool limited_range = false;  // luma 16..235
  double rate_fps = 0;         // 0: the driver does not say
};

// Chooses from what the camera offers and sets it. Unsupported: it cannot do what is asked; the message
// lists what it can. Unavailable: in use by another program, or gone.
[[nodiscard]] Result<Mode> setMode(const Node& node, const LiveCameraOptions& options);

}  // namespace overfly::capture::v4l2
