#include "tiling/planar/workers.h"

#include <algorithm>
#include <atomic>

namespace overfly::tiling {

Workers::Workers(int threads) {
  for (int i = 1; i < threads; ++i) threads_.emplace_back([this](const std::stop_token& stop) { run(stop); });
}

Workers::~Workers() {
  for (std::jthread& thread : threads_) thread.request_stop();
}

void Workers::push(Task task, bool first) {
  {
    const std::lock_guard lock(mutex_);
    if (first)
      tasks_.push_front(std::move(task));
    else
      tasks_.push_back(std::move(task));
  }
  wake_.notify_one();
}

bool Workers::workOnce() {
  Task task;
  {
    const std::lock_guard lock(mutex_);
    if (tasks_.empty()) return false;
    task = std::move(tasks_.front());
    tasks_.pop_front();
  }
  task();
  return true;
}

void Workers::run(const std::stop_token& stop) {
  for (;;) {
    Task task;
    {
      std::unique_lock lock(mutex_);
      if (!wake_.wait(lock, stop, [this] { return !tasks_.empty(); }) || stop.stop_requested()) return;
      task = std::move(tasks_.front());
      tasks_.pop_front();
    }
    task();
  }
}

Result<void> Workers::forEach(std::size_t count, const std::function<Result<void>(std::size_t)>& body) {
  std::atomic<std::size_t> next = 0;
  const auto share = [&]() -> Result<void> {
    for (std::size_t i; (i = next++) < count;)
      if (Result<void> done = body(i); !done) {
        next = count;
        return done;
      }
    return {};
  };
  std::vector<std::future<Result<void>>> others;
  for (std::size_t k = 1; k < std::min(threads_.size() + 1, count); ++k) {
    auto task = std::make_shared<std::packaged_task<Result<void>()>>(share);
    others.push_back(task->get_future());
    push([task] { (*task)(); }, true);
  }
  Result<void> result = share();
  // A share that nobody has taken is at the front: it is done here, and finds nothing left.
  for (auto& other : others)
    if (Result<void> done = get(other); !done && result) result = std::move(done);
  return result;
}

}  // namespace overfly::tiling
