#pragma once
#include "daemon/cli/command.h"
#include "render/gl/gpu_options.h"

namespace overfly::cli {

// The GPU that the settings name ([gpu]), for a command that draws; Context::create's errors and those of the
// settings. Before other threads run.
[[nodiscard]] inline Result<gl::Context> openGpu(const Context& context) {
  const auto loaded = loadSettings(context);
  if (!loaded) return tl::unexpected(loaded.error());
  return gl::Context::create(gl::optionsFrom(loaded->settings.gpu));
}

}  // namespace overfly::cli
