#pragma once
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "capture/camera_source.h"
#include "capture/live/live_source.h"
#include "config/settings.h"

namespace overfly::daemon {

// The camera that [source] and [camera] name, alone. BadSettings: its kind is not in this build.
[[nodiscard]] Result<std::unique_ptr<capture::CameraSource>> makeCamera(const config::Settings& settings);

// The camera joined with what [pose] and [gpio] name. BadSettings: they do not fit together, or the signing
// key cannot be read.
[[nodiscard]] Result<std::unique_ptr<capture::FrameSource>> makeLive(
    const config::Settings& settings, std::unique_ptr<capture::CameraSource> camera);

// For status and /metrics.
[[nodiscard]] nlohmann::json liveJson(const capture::LiveStatus& status);
[[nodiscard]] std::string liveMetrics(const capture::LiveStatus& status);

}  // namespace overfly::daemon
