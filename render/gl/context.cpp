#include "render/gl/context.h"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <cstdlib>

#include "render/gl/detail/open_context.h"
#include "render/gl/devices.h"

namespace overfly::gl {
namespace {

using detail::StatePtr;

// Collects the contexts that one platform offers until a hardware one is found.
class Search {
 public:
  explicit Search(const ContextOptions& options) : options_(options) {
    const char* forced = std::getenv("LIBGL_ALWAYS_SOFTWARE");
    software_will_do_ = forced != nullptr && std::string(forced) != "0" && std::string(forced) != "false";
  }

  void surfaceless() {
    if (!wanted(Platform::Surfaceless) || !offered("EGL_MESA_platform_surfaceless")) return;
    consider("default", {Platform::Surfaceless, nullptr, {}});
  }

  void devices() {
    if (!wanted(Platform::Device) || !offered("EGL_EXT_platform_device")) return;
    for (int i = 0; const auto& device : detail::eglDevices())
      consider(fmt::format("device {}", i++), device);
  }

  void gbm() {
    if (!wanted(Platform::Gbm) || !offered("EGL_KHR_platform_gbm")) return;
    for (const auto& node : detail::renderNodes()) consider(node.node, node);
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
    if (detail::eglOffers(extension)) return true;
    reasons_.push_back(fmt::format("{} is missing", extension));
    return false;
  }
  void consider(const std::string& which, const detail::Opening& opening) {
    if (done()) return;
    auto made = detail::openAt(opening, options_.debug);
    if (!made) {
      reasons_.push_back(
          fmt::format("{} {}: {}", platformName(opening.platform), which, made.error().message));
      return;
    }
    if (!best_ || (best_->info.software && !(*made)->info.software)) best_ = std::move(*made);
  }

  ContextOptions options_;
  std::vector<std::string> reasons_;
  bool software_will_do_ = false;
  StatePtr best_;
};

Result<StatePtr> anyDevice(const ContextOptions& options) {
  Search search(options);
  search.surfaceless();
  search.devices();
  search.gbm();
  return search.take();
}

std::string foundAre(const std::vector<Device>& devices) {
  if (devices.empty()) return "found none";
  return fmt::format("found {}", fmt::join(describe(devices), ", "));
}

Result<StatePtr> thisDevice(const ContextOptions& options) {
  const std::vector<detail::Opening> openings = detail::deviceOpenings();
  // A number or a node is found without waking every GPU; a name is not.
  std::vector<Device> known;
  for (const auto& opening : openings) known.push_back({opening.node, {}, false, {}});
  auto index = pickDevice(known, options.device);
  if (!index) {
    known = listDevices();
    index = pickDevice(known, options.device);
  }
  if (!index)
    return fail(ErrorCode::BadSettings,
                fmt::format("gpu.device: there is no \"{}\" here; {}", options.device, foundAre(known)));
  auto made = detail::openAt(openings[*index], options.debug);
  if (made) return made;
  return fail(ErrorCode::BadSettings, fmt::format("gpu.device: \"{}\" cannot be used: {}; {}", options.device,
                                                  made.error().message, foundAre(listDevices())));
}

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
  auto state = options.device.empty() ? anyDevice(options) : thisDevice(options);
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
