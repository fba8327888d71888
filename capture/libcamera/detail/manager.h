#pragma once
#include <memory>
#include <mutex>

#include "capture/libcamera/detail/api.h"

namespace overfly::capture::lc {

// libcamera allows one CameraManager in a process: shared by all sources, ended with the last of them. Null:
// libcamera did not start. Thread-safe.
[[nodiscard]] std::shared_ptr<libcamera::CameraManager> sharedManager();

}  // namespace overfly::capture::lc
