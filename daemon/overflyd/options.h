#pragma once
#include <filesystem>
#include <memory>

#include "capture/frame_source.h"
#include "config/settings.h"
#include "tiling/adjust/live_adjust.h"
#include "tiling/clipmap/scheduler.h"

namespace overfly::daemon {

// The scheduler's own options from the settings.
[[nodiscard]] tiling::SchedulerOptions schedulerOptions(const config::Settings& settings);

// What is known of this device from earlier flights: its speed, its lenses, an owner's table of operating
// points. Beside the missions, and hidden from their list.
[[nodiscard]] inline std::filesystem::path deviceFolder(const config::Settings& settings) {
  return settings.map.folder / ".device";
}
// The live adjustment's.
[[nodiscard]] tiling::adjust::LiveAdjustOptions adjustOptions(const config::Settings& settings);

// The source that [source] names; with adjust.mode "always" a recorded flight gives what its device recorded.
// Without a path: one that waits for it.
// BadSettings: not in this build.
[[nodiscard]] Result<std::unique_ptr<capture::FrameSource>> makeSource(const config::Settings& settings);

}  // namespace overfly::daemon
