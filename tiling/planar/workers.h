#pragma once
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <stop_token>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "config/error.h"

namespace overfly::tiling {

// Threads that stay, so that what a codec keeps per thread is made once, and memory does not spread over one
// heap per short-lived thread. The thread that waits for a result works too.
// Thread rule: one calling thread; the work itself may not call.
class Workers {
 public:
  // `threads` in all, the calling one among them.
  explicit Workers(int threads);
  ~Workers();  // what has not begun is dropped
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  // Runs after everything posted before.
  template <typename Work>
  [[nodiscard]] auto post(Work work) {
    auto task = std::make_shared<std::packaged_task<std::invoke_result_t<Work>()>>(std::move(work));
    auto future = task->get_future();
    push([task] { (*task)(); }, false);
    return future;
  }

  // Waits, and works meanwhile.
  template <typename T>
  [[nodiscard]] T get(std::future<T>& future) {
    while (future.wait_for(std::chrono::seconds(0)) != std::future_status::ready)
      if (!workOnce()) break;
    return future.get();
  }

  // body(i) for 0 <= i < count, before what was posted; the first error ends it.
  [[nodiscard]] Result<void> forEach(std::size_t count, const std::function<Result<void>(std::size_t)>& body);

 private:
  using Task = std::function<void()>;
  void push(Task task, bool first);
  [[nodiscard]] bool workOnce();
  void run(const std::stop_token& stop);

  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::deque<Task> tasks_;
  std::vector<std::jthread> threads_;  // last: they use everything above
};

}  // namespace overfly::tiling
