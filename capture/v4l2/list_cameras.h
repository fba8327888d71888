#pragma once
#include <memory>
#include <string>
#include <vector>

#include "capture/v4l2/kernel.h"

namespace overfly::capture::v4l2 {

struct FoundCamera {
  std::string path;  // /dev/video0
  std::string card;  // as the driver calls it
  std::string driver;
  std::string problem;  // why it cannot be opened, one sentence; empty: it can
};

// The nodes below /dev/video* that can take pictures, and those that this user may not open. Nothing is
// streamed: a camera in use is listed too.
[[nodiscard]] std::vector<FoundCamera> listCameras(const std::shared_ptr<Kernel>& kernel = systemKernel());

}  // namespace overfly::capture::v4l2
