#pragma once
#include <memory>

#include "capture/frame_source.h"
#include "config/settings.h"
#include "tiling/clipmap/scheduler.h"

namespace overfly::daemon {

// The scheduler's own options from the settings.
[[nodiscard]] tiling::SchedulerOptions schedulerOptions(const config::Settings& settings);

// The source that [source] names. Without a path: one that waits for it.
// BadSettings: not in this build.
[[nodiscard]] Result<std::unique_ptr<capture::FrameSource>> makeSource(const config::Settings& settings);

}  // namespace overfly::daemon
