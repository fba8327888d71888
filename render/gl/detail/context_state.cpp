#include "render/gl/detail/context_state.h"

#include <fmt/core.h>
#include <gbm.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>

namespace overfly::gl::detail {
namespace {

constexpr std::size_t kMaxErrors = 64;
thread_local ContextState* t_current = nullptr;

const char* errorName(GLenum error) {
  switch (error) {
    case GL_INVALID_ENUM:
      return "GL_INVALID_ENUM";
    case GL_INVALID_VALUE:
      return "GL_INVALID_VALUE";
    case GL_INVALID_OPERATION:
      return "GL_INVALID_OPERATION";
    case GL_INVALID_FRAMEBUFFER_OPERATION:
      return "GL_INVALID_FRAMEBUFFER_OPERATION";
    case GL_OUT_OF_MEMORY:
      return "GL_OUT_OF_MEMORY";
    case GL_CONTEXT_LOST_KHR:
      return "GL_CONTEXT_LOST";
    default:
      return "unknown GL error";
  }
}

}  // namespace

ContextState::~ContextState() { destroyContext(); }

void ContextState::bind() {
  if (std::this_thread::get_id() != thread) {
    fmt::print(stderr, "overfly: a GL object was used off its context's thread\n");
    std::abort();
  }
  if (t_current == this) return;
  if (!alive) return;
  if (eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context) == EGL_FALSE) {
    lost = true;
    recordError(fmt::format("eglMakeCurrent failed with 0x{:x}", eglGetError()));
    return;
  }
  t_current = this;
}

void ContextState::destroyContext() noexcept {
  if (!alive) return;
  alive = false;
  if (t_current == this) {
    eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    t_current = nullptr;
  }
  // The display itself is a process-wide singleton of EGL and stays initialised: terminating it would end
  // the other contexts of this process too.
  if (context != EGL_NO_CONTEXT) eglDestroyContext(display, context);
  if (gbm != nullptr) {
    eglTerminate(display);  // this one was made for this device handle alone
    gbm_device_destroy(gbm);
  }
  if (gbm_fd >= 0) close(gbm_fd);
}

void ContextState::recordError(std::string text) {
  if (errors.size() < kMaxErrors) errors.push_back(std::move(text));
}

void ContextState::collectErrors() {
  bind();
  // A lost context may answer GL_CONTEXT_LOST forever: the loop is bounded.
  for (int i = 0; i < 32; ++i) {
    const GLenum error = glGetError();
    if (error == GL_NO_ERROR) break;
    if (error == GL_OUT_OF_MEMORY) out_of_memory = true;
    if (error == GL_CONTEXT_LOST_KHR) lost = true;
    // Out of memory is an outcome that callers are told through Result, not a mistake of theirs.
    if (error != GL_OUT_OF_MEMORY && !info.debug) recordError(errorName(error));
  }
  if (get_reset_status != nullptr && get_reset_status() != GL_NO_ERROR) lost = true;
}

Result<void> ContextState::outcome(const char* what) {
  collectErrors();
  if (lost) return fail(ErrorCode::Unavailable, fmt::format("{}: the GL context was lost", what));
  if (out_of_memory) {
    out_of_memory = false;
    return fail(ErrorCode::Unavailable, fmt::format("{}: the GPU is out of memory", what));
  }
  return {};
}

bool ContextState::hasExtension(std::string_view name) const {
  return std::find(extensions.begin(), extensions.end(), name) != extensions.end();
}

}  // namespace overfly::gl::detail
