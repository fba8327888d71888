#include "render/gl/gpu_options.h"

#include <cstdlib>

namespace overfly::gl {

ContextOptions optionsFrom(const config::Gpu& gpu) {
  if (gpu.software) setenv("LIBGL_ALWAYS_SOFTWARE", "1", 1);
  ContextOptions out;
  out.device = gpu.device;
  return out;
}

}  // namespace overfly::gl
