#pragma once
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "config/error.h"
#include "render/gl/detail/gl_api.h"
#include "render/gl/detail/object.h"
#include "render/gl/device_info.h"

struct gbm_device;

namespace overfly::gl::detail {

// What a context's objects share. Lives as long as the last of them; `alive` says whether GL calls for it
// still have a meaning.
class ContextState {
 public:
  ~ContextState();

  // Ends the program when called off the context's thread; else makes it current if it is not.
  void bind();
  void destroyContext() noexcept;

  void recordError(std::string text);
  // Moves what glGetError holds into `errors`; remembers out of memory and loss.
  void collectErrors();
  // For creations: drains old errors, runs nothing; call again after the GL call through `outcome`.
  [[nodiscard]] Result<void> outcome(const char* what);
  [[nodiscard]] bool hasExtension(std::string_view name) const;

  EGLDisplay display = EGL_NO_DISPLAY;
  EGLContext context = EGL_NO_CONTEXT;
  gbm_device* gbm = nullptr;
  int gbm_fd = -1;
  std::thread::id thread = std::this_thread::get_id();
  bool alive = true;
  bool lost = false;
  bool out_of_memory = false;
  bool refuse_shader = false;  // the next one, for fault tests
  std::vector<std::string> errors;
  std::vector<std::string> extensions;
  DeviceInfo info;
  unsigned empty_vertex_array = 0;  // for draws without attributes
  PFNGLGETGRAPHICSRESETSTATUSKHRPROC get_reset_status = nullptr;
  PFNGLGETQUERYOBJECTUI64VEXTPROC get_query_u64 = nullptr;
  PFNGLQUERYCOUNTEREXTPROC query_counter = nullptr;
};

}  // namespace overfly::gl::detail
