#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>

#include "daemon/overflyd/pipeline.h"

// The mapping thread's dealings with a GPU that may be lost (a reset by its driver) or run out of memory.
namespace overfly::daemon {
namespace {

using namespace std::chrono_literals;

constexpr int kMostTries = 8;  // of one piece of work: then the GPU is of no use
constexpr auto kFirstWait = 100ms, kLongestWait = 5000ms;

}  // namespace

// On the GL thread, before a piece of work: what the mapper had on a GPU that is gone is made anew.
Result<void> Pipeline::readyOnGl(gl::Context& context) {
  context_ = &context;
  if (mapper_ == nullptr || (gl_.generation() == generation_ && !low_memory_)) return {};
  if (auto made = mapper_->renew(context, low_memory_); !made) return made;
  generation_ = gl_.generation();
  low_memory_ = false;
  return {};
}

// ... and between its passes.
bool Pipeline::pauseOnGl(const std::stop_token& stop) {
  beat(Stage::Mapping);
  ++passes_;
  if (gpu_hook_) gpu_hook_(*context_, passes_);
  gl_.giveWay();
  return !stop.stop_requested();
}

// Whether work that ended with this error is worth another try; waits a little, longer each time.
bool Pipeline::triesAgain(const Error& error, const std::stop_token& stop) {
  if (error.code != ErrorCode::Unavailable || stop.stop_requested() || gpu_failures_ >= kMostTries)
    return false;
  spdlog::warn("{}: the work is done again", error.message);
  low_memory_ = !context_lost_;  // the other way to fail
  {
    const std::scoped_lock lock(mutex_);
    ++status_.gpu_failures;
  }
  auto left = std::min<std::chrono::milliseconds>(kLongestWait, kFirstWait * (1 << gpu_failures_));
  ++gpu_failures_;
  for (; left > 0ms && !stop.stop_requested(); left -= 100ms) {
    beat(Stage::Mapping);
    std::this_thread::sleep_for(std::min<std::chrono::milliseconds>(left, 100ms));
  }
  return !stop.stop_requested();
}

}  // namespace overfly::daemon
