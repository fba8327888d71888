#pragma once
#include <cstdint>
#include <functional>
#include <string_view>

#include "config/error.h"
#include "render/gl/context.h"

namespace overfly::daemon {

// How the GPU is made to fail on purpose, for tests: called on the GL thread between the passes of a sweep
// and of an orthophoto, `count` of them after the start.
using GpuHook = std::function<void(gl::Context& context, std::uint64_t count)>;

// A hook from text: "gpu:lost@N" and "gpu:memory@N", at every N-th pass; "gpu:shader@N", at the N-th: the
// shader that is compiled next is refused. BadSettings: not of that form.
[[nodiscard]] Result<GpuHook> parseGpuHook(std::string_view text);

}  // namespace overfly::daemon
