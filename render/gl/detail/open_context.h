#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "render/gl/detail/context_state.h"

// Where contexts come from: EGL's platforms that need no window system.
namespace overfly::gl::detail {

// A place to open a context at.
struct Opening {
  Platform platform = Platform::Device;
  EGLDeviceEXT device = nullptr;  // Platform::Device
  std::string node;               // "/dev/dri/renderD128"; empty: none, or the driver does not tell
};

// Whether EGL itself, apart from any display, has this extension.
[[nodiscard]] bool eglOffers(std::string_view extension);
// What EGL_EXT_platform_device offers, in EGL's order.
[[nodiscard]] std::vector<Opening> eglDevices();
// The kernel's render nodes that are there, for EGL_KHR_platform_gbm.
[[nodiscard]] std::vector<Opening> renderNodes();

// Each GPU and rasteriser once: EGL's devices, then the render nodes that none of them has.
[[nodiscard]] std::vector<Opening> deviceOpenings();

// Unsupported or Unavailable with the reason. The context is current on this thread then.
[[nodiscard]] Result<StatePtr> openAt(const Opening& opening, bool debug);

}  // namespace overfly::gl::detail
