#pragma once
#include <memory>

#include "capture/camera_source.h"
#include "config/settings.h"

namespace overfly::daemon {

// The camera that [source] and [camera] name, alone. BadSettings: its kind is not in this build.
[[nodiscard]] Result<std::unique_ptr<capture::CameraSource>> makeCamera(const config::Settings& settings);

}  // namespace overfly::daemon
