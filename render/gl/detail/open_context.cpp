#include "render/gl/detail/open_context.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <gbm.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <sstream>

#include "render/gl/detail/formats.h"

#ifndef EGL_PLATFORM_SURFACELESS_MESA
#define EGL_PLATFORM_SURFACELESS_MESA 0x31DD
#endif
#ifndef EGL_DRM_RENDER_NODE_FILE_EXT
#define EGL_DRM_RENDER_NODE_FILE_EXT 0x3377
#endif

namespace overfly::gl::detail {
namespace {

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
FormatSupport querySupport(const ContextState& state, const FormatRow& row) {
  FormatSupport out;
  GLuint texture = 0, framebuffer = 0;
  glGenTextures(1, &texture);
  glBindTexture(GL_TEXTURE_2D, texture);
  glTexStorage2D(GL_TEXTURE_2D, 1, row.internal, 4, 4);
  glGenFramebuffers(1, &framebuffer);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  const bool depth = isDepth(row.format);
  glFramebufferTexture2D(GL_FRAMEBUFFER, depth ? GL_DEPTH_ATTACHMENT : GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D,
                         texture, 0);
  out.renderable = glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
  glDeleteFramebuffers(1, &framebuffer);
  glDeleteTextures(1, &texture);
  const bool full_float = row.type == GL_FLOAT;
  const bool integral = isInteger(row.external);
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

std::string nodeOfDevice(EGLDeviceEXT device) {
  const auto query = entry<PFNEGLQUERYDEVICESTRINGEXTPROC>("eglQueryDeviceStringEXT");
  if (query == nullptr || device == EGL_NO_DEVICE_EXT) return {};
  const auto extensions = words(query(device, EGL_EXTENSIONS));
  const char* node = nullptr;
  if (contains(extensions, "EGL_EXT_device_drm_render_node"))
    node = query(device, EGL_DRM_RENDER_NODE_FILE_EXT);
  if (node == nullptr && contains(extensions, "EGL_EXT_device_drm"))
    node = query(device, EGL_DRM_DEVICE_FILE_EXT);
  return node == nullptr ? "" : node;
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
    info.formats[static_cast<std::size_t>(i)] = querySupport(state, row(format));
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

// Of a display, where its driver tells.
std::string nodeOfDisplay(EGLDisplay display) {
  const auto query = entry<PFNEGLQUERYDISPLAYATTRIBEXTPROC>("eglQueryDisplayAttribEXT");
  EGLAttrib device = 0;
  if (query == nullptr || query(display, EGL_DEVICE_EXT, &device) == EGL_FALSE || device == 0) return {};
  return nodeOfDevice(reinterpret_cast<EGLDeviceEXT>(device));
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
  state->info.node = nodeOfDisplay(display);
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

}  // namespace

bool eglOffers(std::string_view extension) {
  return contains(words(eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS)), extension);
}

std::vector<Opening> eglDevices() {
  const auto query = entry<PFNEGLQUERYDEVICESEXTPROC>("eglQueryDevicesEXT");
  std::array<EGLDeviceEXT, 16> found{};
  EGLint count = 0;
  if (!eglOffers("EGL_EXT_platform_device") || query == nullptr ||
      query(static_cast<EGLint>(found.size()), found.data(), &count) == EGL_FALSE)
    return {};
  std::vector<Opening> out;
  for (EGLint i = 0; i < count; ++i) {
    const EGLDeviceEXT device = found[static_cast<std::size_t>(i)];
    out.push_back({Platform::Device, device, nodeOfDevice(device)});
  }
  return out;
}

std::vector<Opening> renderNodes() {
  if (!eglOffers("EGL_KHR_platform_gbm")) return {};
  std::vector<Opening> out;
  for (int node = 128; node < 136; ++node) {
    std::string path = fmt::format("/dev/dri/renderD{}", node);
    if (std::error_code code; std::filesystem::exists(path, code))
      out.push_back({Platform::Gbm, nullptr, std::move(path)});
  }
  return out;
}

std::vector<Opening> deviceOpenings() {
  std::vector<Opening> out = eglDevices();
  for (Opening& node : renderNodes())
    if (std::none_of(out.begin(), out.end(), [&](const Opening& known) { return known.node == node.node; }))
      out.push_back(std::move(node));
  return out;
}

Result<StatePtr> openAt(const Opening& opening, bool debug) {
  switch (opening.platform) {
    case Platform::Surfaceless:
      return onDisplay(platformDisplay(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY),
                       Platform::Surfaceless, debug, nullptr, -1);
    case Platform::Device:
      return onDisplay(platformDisplay(EGL_PLATFORM_DEVICE_EXT, opening.device), Platform::Device, debug,
                       nullptr, -1);
    case Platform::Gbm:
      break;
  }
  const int fd = open(opening.node.c_str(), O_RDWR | O_CLOEXEC);
  if (fd < 0) return fail(ErrorCode::Unavailable, std::strerror(errno));
  gbm_device* device = gbm_create_device(fd);
  const EGLDisplay display =
      device == nullptr ? EGL_NO_DISPLAY : platformDisplay(EGL_PLATFORM_GBM_KHR, device);
  auto out = onDisplay(display, Platform::Gbm, debug, device, fd);
  if (out) (*out)->info.node = opening.node;
  return out;
}

}  // namespace overfly::gl::detail
