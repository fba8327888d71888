#pragma once
#include <chrono>
#include <memory>

#include "config/error.h"
#include "render/gl/context.h"

namespace overfly::gl {

// A mark in the GPU's work: everything submitted before it. Thread-bound to its context.
class Fence {
 public:
  Fence() = default;
  [[nodiscard]] static Fence insert(Context& context);
  ~Fence();
  Fence(Fence&& other) noexcept;
  Fence& operator=(Fence&& other) noexcept;

  // True once the work before the mark is done. An empty fence is always done.
  [[nodiscard]] bool done() const;
  // Waits at most `timeout`; false when it is not done by then, Unavailable when the context was lost.
  [[nodiscard]] Result<bool> wait(std::chrono::nanoseconds timeout) const;

 private:
  void release() noexcept;
  detail::StatePtr state_;
  void* sync_ = nullptr;
};

}  // namespace overfly::gl
