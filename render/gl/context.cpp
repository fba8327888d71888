#include "render/gl/context.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <fmt/ranges.h>
#include <gbm.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "render/gl/detail/context_state.h"
#include "render/gl/detail/formats.h"

#ifndef EGL_PLATFORM_SURFACELESS_MESA
#define EGL_PLATFORM_SURFACELESS_MESA 0x31DD
#endif

namespace overfly::gl {
namespace {

using detail::ContextState;
using detail::StatePtr;

std::vector<std::string> words(const char* text) {
  std::vector<std::string> out;
  std::istringstream stream(text == nullptr ? "" : text);
  for (std::string word; stream >> word;) out.push_back(word);
  return out;
}

bool contains(const std::vector<std::string>& list, std::string_view name) {
  return std::find(list.begin(), list.end(), name) != list.end();
}

template <typename F>
F entry(const char* name) {
  return reinterpret_cast<F>(eglGetProcAddress(name));
}

void GL_APIENTRY onDebugMessage(GLenum source, GLenum type, GLuint, GLenum, GLsizei length,
                                const GLchar* message, const void* user) {
  // Failed compilations are reported through Result with file and line.
  if (source == GL_DEBUG_SOURCE_SHADER_COMPILER_KHR) return;
  if (type != GL_DEBUG_TYPE_ERROR_KHR && type != GL_DEBUG_TYPE_UNDEFINED_BEHAVIOR_KHR) return;
  const std::string text =
      length >= 0 ? std::string(message, static_cast<std::size_t>(length)) : std::string(message);
  if (text.find("GL_OUT_OF_MEMORY") != std::string::npos) return;
  static_cast<ContextState*>(const_cast<void*>(user))->recordError(text);
}

int integer(GLenum what) {
  GLint value = 0;
  glGetIntegerv(what, &value);
  return value;
}

Limits queryLimits() {
  Limits out;
  out.texture_size = integer(GL_MAX_TEXTURE_SIZE);
  out.texture_layers = integer(GL_MAX_ARRAY_TEXTURE_LAYERS);
  out.texture_units = integer(GL_MAX_TEXTURE_IMAGE_UNITS);
  out.compute_texture_units = integer(GL_MAX_COMPUTE_TEXTURE_IMAGE_UNITS);
  out.compute_invocations = integer(GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS);
  for (unsigned i = 0; i < 3; ++i) {
    glGetIntegeri_v(GL_MAX_COMPUTE_WORK_GROUP_COUNT, i, &out.compute_group_count[i]);
    glGetIntegeri_v(GL_MAX_COMPUTE_WORK_GROUP_SIZE, i, &out.compute_group_size[i]);
  }
  out.compute_shared_bytes = integer(GL_MAX_COMPUTE_SHARED_MEMORY_SIZE);
  out.compute_images = integer(GL_MAX_COMPUTE_IMAGE_UNIFORMS);
  out.fragment_images = integer(GL_MAX_FRAGMENT_IMAGE_UNIFORMS);
  out.compute_storage_blocks = integer(GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS);
  out.fragment_storage_blocks = integer(GL_MAX_FRAGMENT_SHADER_STORAGE_BLOCKS);
  GLint64 block = 0;
  glGetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &block);
  out.storage_block_bytes = block;
  out.uniform_block_bytes = integer(GL_MAX_UNIFORM_BLOCK_SIZE);
  out.draw_buffers = integer(GL_MAX_DRAW_BUFFERS);
  return out;
}

// Asks the driver itself by building a small target of the format, since extension strings name several
// overlapping sets.
FormatSupport querySupport(const ContextState& state, const detail::FormatRow& row) {
  FormatSupport out;
  GLuint texture = 0, framebuffer = 0;
  glGenTextures(1, &texture);
  glBindTexture(GL_TEXTURE_2D, texture);
  glTexStorage2D(GL_TEXTURE_2D, 1, row.internal, 4, 4);
  glGenFramebuffers(1, &framebuffer);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  const bool depth = detail::isDepth(row.format);
  glFramebufferTexture2D(GL_FRAMEBUFFER, depth ? GL_DEPTH_ATTACHMENT : GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D,
                         texture, 0);
  out.renderable = glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
  glDeleteFramebuffers(1, &framebuffer);
  glDeleteTextures(1, &texture);
  const bool full_float = row.type == GL_FLOAT;
  const bool integral = detail::isInteger(row.external);
  out.filterable = !integral && !depth && (!full_float || state.hasExtension("GL_OES_texture_float_linear"));
  out.blendable =
      out.renderable && !integral && !depth && (!full_float || state.hasExtension("GL_EXT_float_blend"));
  while (glGetError() != GL_NO_ERROR) {
  }
  return out;
}

bool isSoftware(const std::string& renderer) {
  for (const char* name : {"llvmpipe", "softpipe", "SwiftShader", "swrast", "Software"}) {
    if (renderer.find(name) != std::string::npos) return true;
  }
  return false;
}

std::string glText(GLenum what) {
  const auto* text = reinterpret_cast<const char*>(glGetString(what));
  return text == nullptr ? "" : text;
}

void describe(ContextState& state, Platform platform) {
  DeviceInfo& info = state.info;
  info.platform = platform;
  info.vendor = glText(GL_VENDOR);
  info.renderer = glText(GL_RENDERER);
  info.version = glText(GL_VERSION);
  info.shading_language = glText(GL_SHADING_LANGUAGE_VERSION);
  info.major = integer(GL_MAJOR_VERSION);
  info.minor = integer(GL_MINOR_VERSION);
  info.software = isSoftware(info.renderer);
  state.extensions = words(reinterpret_cast<const char*>(glGetString(GL_EXTENSIONS)));
  GLint range[2] = {0, 0}, precision = 0;
  glGetShaderPrecisionFormat(GL_FRAGMENT_SHADER, GL_HIGH_FLOAT, range, &precision);
  info.fragment_highp_bits = precision;
  info.limits = queryLimits();
  for (int i = 0; i < kFormatCount; ++i) {
    const auto format = static_cast<Format>(i);
    info.formats[static_cast<std::size_t>(i)] = querySupport(state, detail::row(format));
  }
  if (state.hasExtension("GL_EXT_disjoint_timer_query")) {
    state.get_query_u64 = entry<PFNGLGETQUERYOBJECTUI64VEXTPROC>("glGetQueryObjectui64vEXT");
    state.query_counter = entry<PFNGLQUERYCOUNTEREXTPROC>("glQueryCounterEXT");
  }
  info.gpu_timer = state.get_query_u64 != nullptr && state.query_counter != nullptr;
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
  glDisable(GL_DITHER);
}

void enableDebug(ContextState& state) {
  if (!state.hasExtension("GL_KHR_debug")) return;
  const auto callback = entry<PFNGLDEBUGMESSAGECALLBACKKHRPROC>("glDebugMessageCallbackKHR");
  if (callback == nullptr) return;
  callback(onDebugMessage, &state);
  glEnable(GL_DEBUG_OUTPUT_KHR);
  glEnable(GL_DEBUG_OUTPUT_SYNCHRONOUS_KHR);
  state.info.debug = true;
}

// Makes the context on an opened display; takes over `gbm` and `fd` in every case.
Result<StatePtr> onDisplay(EGLDisplay display, Platform platform, bool debug, gbm_device* gbm, int fd) {
  auto state = std::make_shared<ContextState>();
  state->display = display;
  state->gbm = gbm;
  state->gbm_fd = fd;
  if (display == EGL_NO_DISPLAY) return fail(ErrorCode::Unsupported, "no EGL display");
  EGLint major = 0, minor = 0;
  if (eglInitialize(display, &major, &minor) == EGL_FALSE) {
    return fail(ErrorCode::Unsupported, fmt::format("eglInitialize failed with 0x{:x}", eglGetError()));
  }
  const auto extensions = words(eglQueryString(display, EGL_EXTENSIONS));
  if (!contains(extensions, "EGL_KHR_surfaceless_context")) {
    return fail(ErrorCode::Unsupported, "EGL_KHR_surfaceless_context is missing");
  }
  if (eglBindAPI(EGL_OPENGL_ES_API) == EGL_FALSE) return fail(ErrorCode::Unsupported, "no OpenGL ES");
  EGLConfig config = EGL_NO_CONFIG_KHR;
  if (!contains(extensions, "EGL_KHR_no_config_context")) {
    const EGLint wanted[] = {EGL_SURFACE_TYPE, 0, EGL_RENDERABLE_TYPE, EGL_OPENGL_ES3_BIT, EGL_NONE};
    EGLint count = 0;
    if (eglChooseConfig(display, wanted, &config, 1, &count) == EGL_FALSE || count == 0) {
      return fail(ErrorCode::Unsupported, "no EGL configuration with OpenGL ES 3");
    }
  }
  std::vector<EGLint> attributes{EGL_CONTEXT_MAJOR_VERSION, 3, EGL_CONTEXT_MINOR_VERSION, 1};
  if (debug) attributes.insert(attributes.end(), {EGL_CONTEXT_OPENGL_DEBUG, EGL_TRUE});
  bool notification = contains(extensions, "EGL_EXT_create_context_robustness");
  if (notification) {
    auto robust = attributes;
    robust.insert(robust.end(), {EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY_EXT,
                                 EGL_LOSE_CONTEXT_ON_RESET_EXT, EGL_NONE});
    state->context = eglCreateContext(display, config, EGL_NO_CONTEXT, robust.data());
    notification = state->context != EGL_NO_CONTEXT;
  }
  if (state->context == EGL_NO_CONTEXT) {
    attributes.push_back(EGL_NONE);
    state->context = eglCreateContext(display, config, EGL_NO_CONTEXT, attributes.data());
  }
  if (state->context == EGL_NO_CONTEXT) {
    return fail(ErrorCode::Unsupported, fmt::format("no OpenGL ES 3.1 context (0x{:x})", eglGetError()));
  }
  state->bind();
  if (state->lost) return fail(ErrorCode::Unsupported, "the new context cannot be made current");
  describe(*state, platform);
  if (notification) {
    state->get_reset_status = entry<PFNGLGETGRAPHICSRESETSTATUSKHRPROC>("glGetGraphicsResetStatusKHR");
    state->info.reset_notification = state->get_reset_status != nullptr;
  }
  if (debug) enableDebug(*state);
  glGenVertexArrays(1, &state->empty_vertex_array);
  return state;
}

EGLDisplay platformDisplay(EGLenum platform, void* native) {
  const auto get = entry<PFNEGLGETPLATFORMDISPLAYEXTPROC>("eglGetPlatformDisplayEXT");
  return get == nullptr ? EGL_NO_DISPLAY : get(platform, native, nullptr);
}

// Collects the contexts that one platform offers until a hardware one is found.
class Search {
 public:
  explicit Search(const ContextOptions& options)
      : options_(options), client_(words(eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS))) {
    const char* forced = std::getenv("LIBGL_ALWAYS_SOFTWARE");
    software_will_do_ = forced != nullptr && std::string(forced) != "0" && std::string(forced) != "false";
  }

  void surfaceless() {
    if (!wanted(Platform::Surfaceless) || !offered("EGL_MESA_platform_surfaceless")) return;
    consider(Platform::Surfaceless, "default",
             onDisplay(platformDisplay(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY),
                       Platform::Surfaceless, options_.debug, nullptr, -1));
  }

  void devices() {
    if (!wanted(Platform::Device) || !offered("EGL_EXT_platform_device")) return;
    const auto query = entry<PFNEGLQUERYDEVICESEXTPROC>("eglQueryDevicesEXT");
    std::array<EGLDeviceEXT, 16> found{};
    EGLint count = 0;
    if (query == nullptr || query(static_cast<EGLint>(found.size()), found.data(), &count) == EGL_FALSE)
      return;
    for (EGLint i = 0; i < count && !done(); ++i) {
      consider(Platform::Device, fmt::format("device {}", i),
               onDisplay(platformDisplay(EGL_PLATFORM_DEVICE_EXT, found[static_cast<std::size_t>(i)]),
                         Platform::Device, options_.debug, nullptr, -1));
    }
  }

  void gbm() {
    if (!wanted(Platform::Gbm) || !offered("EGL_KHR_platform_gbm")) return;
    for (int node = 128; node < 136 && !done(); ++node) {
      const std::string path = fmt::format("/dev/dri/renderD{}", node);
      const int fd = open(path.c_str(), O_RDWR | O_CLOEXEC);
      if (fd < 0) continue;
      gbm_device* device = gbm_create_device(fd);
      const EGLDisplay display =
          device == nullptr ? EGL_NO_DISPLAY : platformDisplay(EGL_PLATFORM_GBM_KHR, device);
      consider(Platform::Gbm, path, onDisplay(display, Platform::Gbm, options_.debug, device, fd));
    }
  }

  Result<StatePtr> take() {
    if (best_) return best_;
    return fail(ErrorCode::Unsupported,
                fmt::format("No OpenGL ES 3.1 without a window system was found ({}); install Mesa "
                            "(libegl-mesa0, libgl1-mesa-dri) or the GPU's driver.",
                            reasons_.empty() ? "EGL offers no such platform"
                                             : fmt::format("{}", fmt::join(reasons_, "; "))));
  }

 private:
  [[nodiscard]] bool done() const { return best_ && (software_will_do_ || !best_->info.software); }
  [[nodiscard]] bool wanted(Platform platform) const {
    return !done() && (!options_.platform || *options_.platform == platform);
  }
  bool offered(const char* extension) {
    if (contains(client_, extension)) return true;
    reasons_.push_back(fmt::format("{} is missing", extension));
    return false;
  }
  void consider(Platform platform, const std::string& which, Result<StatePtr> made) {
    if (!made) {
      reasons_.push_back(fmt::format("{} {}: {}", platformName(platform), which, made.error().message));
      return;
    }
    if (!best_ || (best_->info.software && !(*made)->info.software)) best_ = std::move(*made);
  }

  ContextOptions options_;
  std::vector<std::string> client_;
  std::vector<std::string> reasons_;
  bool software_will_do_ = false;
  StatePtr best_;
};

}  // namespace

std::string_view platformName(Platform platform) {
  switch (platform) {
    case Platform::Surfaceless:
      return "surfaceless";
    case Platform::Device:
      return "device";
    case Platform::Gbm:
      return "gbm";
  }
  return "";
}

Context::Context(StatePtr state) : state_(std::move(state)) {}
Context::Context(Context&&) noexcept = default;

Context& Context::operator=(Context&& other) noexcept {
  if (this != &other) {
    if (state_) state_->destroyContext();
    state_ = std::move(other.state_);
  }
  return *this;
}

Context::~Context() {
  if (!state_) return;
  state_->bind();
  if (state_->alive && state_->empty_vertex_array != 0) glDeleteVertexArrays(1, &state_->empty_vertex_array);
  state_->destroyContext();
}

Result<Context> Context::create(const ContextOptions& options) {
  Search search(options);
  search.surfaceless();
  search.devices();
  search.gbm();
  auto state = search.take();
  if (!state) return tl::unexpected(state.error());
  (*state)->bind();
  return Context(std::move(*state));
}

const DeviceInfo& Context::info() const { return state_->info; }

Result<void> Context::check() { return state_->outcome("GPU"); }

bool Context::lost() const { return state_->lost; }

std::vector<std::string> Context::takeErrors() {
  state_->collectErrors();
  return std::exchange(state_->errors, {});
}

void Context::finish() {
  state_->bind();
  glFinish();
}

void Context::injectLoss() { state_->lost = true; }

void Context::injectOutOfMemory() { state_->out_of_memory = true; }

void Context::injectShaderRefusal() { state_->refuse_shader = true; }

}  // namespace overfly::gl
