#pragma once
#include "config/settings.h"
#include "render/gl/context.h"

namespace overfly::gl {

// The context that the settings ask for. gpu.software is Mesa's own switch, a variable of this process's
// environment: call this before the first context is made and before other threads run.
[[nodiscard]] ContextOptions optionsFrom(const config::Gpu& gpu);

}  // namespace overfly::gl
