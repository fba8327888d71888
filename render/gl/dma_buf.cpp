#include "render/gl/dma_buf.h"

#include <sstream>
#include <string>

#include "render/gl/detail/context_state.h"

namespace overfly::gl {

bool importsDmaBufs(const Context& context) {
  const char* extensions = eglQueryString(context.state()->display, EGL_EXTENSIONS);
  std::istringstream words(extensions != nullptr ? extensions : "");
  for (std::string word; words >> word;)
    if (word == "EGL_EXT_image_dma_buf_import") return true;
  return false;
}

}  // namespace overfly::gl
