#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "config/error.h"
#include "render/gl/detail/object.h"
#include "render/gl/device_info.h"

namespace overfly::gl {

struct ContextOptions {
  std::optional<Platform> platform;  // absent: the first that works, hardware before software
  std::string device;                // this one alone, as pickDevice() reads it; empty: any
#ifdef NDEBUG
  bool debug = false;
#else
  bool debug = true;  // collect KHR_debug errors, synchronously (slower)
#endif
};

// An OpenGL ES 3.1 (or later) context without a window.
//
// Thread rule: a context and everything made with it belong to the thread that created it, and are used and
// destroyed there; any use on another thread ends the program with a message. Several contexts may live on
// one thread; the right one is made current by use. Objects may outlive their context: they are then empty
// shells whose destruction is harmless.
class Context {
 public:
  // Unsupported with the reasons of every platform tried when no OpenGL ES 3.1 can be had; BadSettings with
  // the devices that there are when the one asked for is not among them or cannot be used.
  [[nodiscard]] static Result<Context> create(const ContextOptions& options = {});
  ~Context();
  Context(Context&&) noexcept;
  Context& operator=(Context&&) noexcept;

  [[nodiscard]] const DeviceInfo& info() const;

  // Unavailable when the context was lost or memory ran out since the last call; after a loss this and every
  // creation keep failing until the owner drops the context and all objects and builds them again.
  [[nodiscard]] Result<void> check();
  [[nodiscard]] bool lost() const;

  // GL errors since the last call (with debug: as they happened, with the driver's text; without: what
  // glGetError still holds). Tests assert that it is empty. At most 64 are kept.
  [[nodiscard]] std::vector<std::string> takeErrors();

  // Waits until the GPU has done everything submitted so far.
  void finish();

  // Makes the context count as lost from now on, as a GPU reset would: for fault tests.
  void injectLoss();
  // Makes the next check() say that memory ran out.
  void injectOutOfMemory();
  // Makes the compiler refuse the next shader.
  void injectShaderRefusal();

  // For the classes of this folder.
  [[nodiscard]] const detail::StatePtr& state() const { return state_; }

 private:
  explicit Context(detail::StatePtr state);
  detail::StatePtr state_;
};

}  // namespace overfly::gl
