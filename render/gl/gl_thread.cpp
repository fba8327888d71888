#include "render/gl/gl_thread.h"

#include <pthread.h>

#include <algorithm>
#include <utility>

#include "config/niceness.h"

namespace overfly::gl {
namespace {

const Error kStopped{ErrorCode::Unavailable, "the GPU thread has ended"};

}  // namespace

Result<std::unique_ptr<GlThread>> GlThread::start(const ContextOptions& options) {
  std::unique_ptr<GlThread> out(new GlThread(options));
  std::promise<Result<void>> started;
  auto ready = started.get_future();
  out->thread_ = std::jthread(
      [self = out.get()](const std::stop_token& stop, std::promise<Result<void>> promise) {
        // Before the context: a software rasteriser's threads take after the one that makes it.
        standBack(kMappingNiceness);
        (void)pthread_setname_np(pthread_self(), "gl");
        self->serve(stop, std::move(promise));
      },
      std::move(started));
  if (auto done = ready.get(); !done) return tl::unexpected(done.error());
  return out;
}

GlThread::~GlThread() {
  thread_.request_stop();
  thread_.join();
}

void GlThread::enqueue(Priority priority, Job job) {
  job.since = std::chrono::steady_clock::now();
  {
    const std::lock_guard lock(mutex_);
    if (!closed_) {
      ++stats_.jobs;
      queues_[static_cast<std::size_t>(priority)].push_back(std::move(job));
      wake_.notify_one();
      return;
    }
  }
  job.cancel(kStopped);
}

std::future<Result<void>> GlThread::submitSliced(Priority priority, std::string name, SlicedWork work) {
  auto promise = std::make_shared<std::promise<Result<void>>>();
  auto future = promise->get_future();
  enqueue(priority, {std::move(name),
                     [promise, work = std::move(work)](Context& context, const SliceClock& clock) {
                       try {
                         const auto done = work(context, clock);
                         if (done && !*done) {
                           auto healthy = context.check();
                           if (healthy) return false;
                           promise->set_value(std::move(healthy));
                           return true;
                         }
                         if (done) {
                           promise->set_value({});
                         } else {
                           promise->set_value(tl::unexpected(done.error()));
                         }
                       } catch (...) {
                         promise->set_exception(std::current_exception());
                       }
                       return true;
                     },
                     [promise](const Error& error) { promise->set_value(tl::unexpected(error)); },
                     {}});
  return future;
}

DeviceInfo GlThread::info() const {
  const std::lock_guard lock(mutex_);
  return info_;
}

GlThreadStats GlThread::stats() const {
  const std::lock_guard lock(mutex_);
  GlThreadStats out = stats_;
  out.generation = generation_.load();
  for (std::size_t i = 0; i < queues_.size(); ++i) out.waiting[i] = queues_[i].size();
  return out;
}

bool GlThread::othersWait() const {
  return std::any_of(queues_.begin() + 1, queues_.end(), [](const auto& queue) { return !queue.empty(); });
}

// The next job: the front of the highest priority, or of a lower one whose front has lost its patience (the
// longest waiting of those).
std::optional<std::pair<int, GlThread::Job>> GlThread::take(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  const auto any = [this] {
    for (const auto& queue : queues_) {
      if (!queue.empty()) return true;
    }
    return false;
  };
  wake_.wait(lock, stop, any);
  if (stop.stop_requested()) return std::nullopt;
  const auto now = std::chrono::steady_clock::now();
  int chosen = -1, impatient = -1;
  const bool others = othersWait();
  for (int i = 0; i < kPriorities; ++i) {
    const auto& queue = queues_[static_cast<std::size_t>(i)];
    if (queue.empty() || (i == 0 && others && !previewMayRun())) continue;
    if (chosen < 0) chosen = i;
    const auto since = queue.front().since;
    if (now - since >= kPatience &&
        (impatient < 0 || since < queues_[static_cast<std::size_t>(impatient)].front().since)) {
      impatient = i;
    }
  }
  if (impatient >= 0) chosen = impatient;
  auto& queue = queues_[static_cast<std::size_t>(chosen)];
  std::pair<int, Job> out(chosen, std::move(queue.front()));
  queue.pop_front();
  return out;
}

void GlThread::account(int priority, const std::string& name, std::chrono::steady_clock::time_point begin) {
  const std::chrono::nanoseconds took = std::chrono::steady_clock::now() - begin;
  ++stats_.slices;
  stats_.busy[static_cast<std::size_t>(priority)] += took;
  if (took > 2 * SliceClock::kSlice) ++stats_.long_slices;
  if (took > stats_.longest_slice) {
    stats_.longest_slice = took;
    stats_.longest_job = name;
  }
  const double count = static_cast<double>(took.count());
  if (priority == 0) {
    if (nested_ || othersWait()) earned_ -= took;
  } else if (preview_share_ < 1) {
    earned_ +=
        std::chrono::nanoseconds(static_cast<std::int64_t>(count * preview_share_ / (1.0 - preview_share_)));
  }
  earned_ = std::clamp<std::chrono::nanoseconds>(earned_, -4 * kMostEarned, kMostEarned);
}

void GlThread::runSlice(Context& context, int priority, Job job) {
  running_context_ = &context;
  running_priority_ = priority;
  running_name_ = job.name;
  slice_begin_ = std::chrono::steady_clock::now();
  const bool done = job.slice(context, SliceClock());
  if (!context.lost()) context.finish();
  const std::lock_guard lock(mutex_);
  account(priority, job.name, slice_begin_);
  if (done) return;
  job.since = std::chrono::steady_clock::now();
  queues_[static_cast<std::size_t>(priority)].push_back(std::move(job));
}

void GlThread::giveWay() {
  const int priority = running_priority_;
  if (running_context_ == nullptr || priority == 0) return;
  Context& context = *running_context_;
  const std::string name = running_name_;
  bool waiting = false;
  {
    const std::lock_guard lock(mutex_);
    waiting = !queues_[0].empty() && !context.lost();
  }
  if (waiting) context.finish();
  std::unique_lock lock(mutex_);
  account(priority, name, slice_begin_);
  while (waiting && !queues_[0].empty() && previewMayRun() && !context.lost()) {
    Job preview = std::move(queues_[0].front());
    queues_[0].pop_front();
    nested_ = true;
    lock.unlock();
    runSlice(context, 0, std::move(preview));
    lock.lock();
    nested_ = false;
  }
  running_priority_ = priority;
  running_name_ = name;
  slice_begin_ = std::chrono::steady_clock::now();
}

void GlThread::setPreviewShare(double share) {
  const std::lock_guard lock(mutex_);
  preview_share_ = std::clamp(share, 0.0, 1.0);
  if (preview_share_ <= 0) earned_ = std::chrono::nanoseconds(0);
}

Result<void> GlThread::ensureContext(std::optional<Context>& context) {
  if (context && !context->lost()) return {};
  running_context_ = nullptr;
  context.reset();  // objects that are still around become empty shells
  auto made = Context::create(options_);
  if (!made) return tl::unexpected(made.error());
  context.emplace(std::move(*made));
  const std::lock_guard lock(mutex_);
  info_ = context->info();
  ++generation_;
  return {};
}

void GlThread::serve(const std::stop_token& stop, std::promise<Result<void>> started) {
  std::optional<Context> context;
  auto ready = ensureContext(context);
  const bool usable = ready.has_value();
  started.set_value(std::move(ready));
  while (usable) {
    auto next = take(stop);
    if (!next) break;
    if (auto alive = ensureContext(context); alive) {
      runSlice(*context, next->first, std::move(next->second));
    } else {
      next->second.cancel({ErrorCode::Unavailable, alive.error().message});
    }
  }
  std::array<std::deque<Job>, kPriorities> left;
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    left.swap(queues_);
  }
  for (auto& queue : left) {
    for (Job& job : queue) job.cancel(kStopped);
  }
}

}  // namespace overfly::gl
