#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>

#include "capture/frame_source.h"
#include "config/settings.h"
#include "daemon/overflyd/pipeline.h"
#include "render/gl/gl_thread.h"

// A pipeline within the test's process, fed with the smoke flight by the mock camera.
namespace overfly::test {

inline constexpr std::uint64_t kSmokeFrames = 9;

[[nodiscard]] std::unique_ptr<gl::GlThread> glThread();

struct PipelineFolder {
  PipelineFolder();
  ~PipelineFolder();
  PipelineFolder(const PipelineFolder&) = delete;
  PipelineFolder& operator=(const PipelineFolder&) = delete;
  std::filesystem::path path;
};

// Defaults, whatever room the disk has.
[[nodiscard]] config::Settings settingsHere();

// `raw`: with the poses that the drone itself knew.
[[nodiscard]] std::unique_ptr<capture::FrameSource> smokeSource(double speed, bool raw = false);

// False: it failed, or took longer than five minutes.
[[nodiscard]] bool waitUntilMapped(const daemon::Pipeline& pipeline);

// The map holds, byte for byte, what all frames of the smoke flight give at once: of how many coded layers
// that is not so; SIZE_MAX: there is no such map.
[[nodiscard]] std::size_t layersUnlikeAllFramesAtOnce(const std::filesystem::path& map,
                                                      const config::Settings& settings, gl::GlThread& gl);

}  // namespace overfly::test
