#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "capture/live_camera_options.h"
#include "capture/v4l2/detail/node.h"

namespace overfly::capture::v4l2 {

// What the camera's controls were set to.
struct Controls {
  std::int64_t exposure_ns = 0;      // 0: automatic, hence unknown
  std::vector<std::string> missing;  // asked for, and not to be had: "no exposure control"
};

// Exposure and gain by hand or automatic, focus fixed. A camera without a control that nobody asked for is
// left as it is. V4L2 gives gain no unit: the number is handed to the driver as it is, within its range.
[[nodiscard]] Controls setControls(const Node& node, const LiveCameraOptions& options);

}  // namespace overfly::capture::v4l2
