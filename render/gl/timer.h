#pragma once
#include <chrono>
#include <optional>

#include "config/error.h"
#include "render/gl/context.h"

namespace overfly::gl {

// Time of GPU work between start() and stop(): EXT_disjoint_timer_query where there is one, else the CPU's
// clock around a finish at both ends (then start and stop wait). llvmpipe has the extension, but does its
// work on submission threads whose stamps are not those of the work: software devices use the CPU's clock.
// Thread-bound to its context; one measurement at a time.
class GpuTimer {
 public:
  GpuTimer() = default;
  [[nodiscard]] static Result<GpuTimer> create(Context& context);

  void start();
  void stop();
  // Nanoseconds of the last start..stop; waits for the GPU. nullopt when the measurement is void (a clock
  // change on the GPU in between).
  [[nodiscard]] std::optional<std::chrono::nanoseconds> elapsed();
  [[nodiscard]] bool onGpu() const { return on_gpu_; }

 private:
  detail::Object begin_, end_;
  detail::StatePtr state_;
  bool on_gpu_ = false;
  std::chrono::steady_clock::time_point cpu_begin_{}, cpu_end_{};
};

}  // namespace overfly::gl
