#pragma once
#include "render/gl/context.h"

namespace overfly::gl {

// True where a camera's dma-buf can become a texture without a copy (EGL_EXT_image_dma_buf_import). Mesa's
// software rasteriser has it only beside a DRM node. On the context's thread.
[[nodiscard]] bool importsDmaBufs(const Context& context);

}  // namespace overfly::gl
