#pragma once
#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <type_traits>

#include "config/error.h"
#include "render/gl/context.h"

namespace overfly::gl {

// Who is served first when several wait.
enum class Priority { Preview, Mapping, Background };
inline constexpr int kPriorities = 3;

// How much of its slice a job has left. Small GPUs are reset by the driver when one submission runs long,
// and a preview that waits longer feels broken.
class SliceClock {
 public:
  static constexpr std::chrono::milliseconds kSlice{50};
  SliceClock() : end_(std::chrono::steady_clock::now() + kSlice) {}
  [[nodiscard]] bool over() const { return std::chrono::steady_clock::now() >= end_; }
  [[nodiscard]] std::chrono::nanoseconds left() const { return end_ - std::chrono::steady_clock::now(); }

 private:
  std::chrono::steady_clock::time_point end_;
};

struct GlThreadStats {
  std::uint64_t jobs = 0;
  std::uint64_t slices = 0;
  std::array<std::chrono::nanoseconds, kPriorities> busy{};  // time used, by priority
  std::uint64_t long_slices = 0;                             // that took more than twice SliceClock::kSlice
  std::chrono::nanoseconds longest_slice{0};
  std::string longest_job;       // its name
  std::uint64_t generation = 0;  // see GlThread::generation
  std::array<std::size_t, kPriorities> waiting{};
};

// The one thread that owns the GPU context and serves mapping and preview. Jobs run in slices; between two
// slices of a job others may run: by priority, in turn among equals, and a job that has waited for
// kPatience is served before a higher priority, so that a busy preview does not starve the map.
// A slice's GPU work is finished before the next slice begins. A job that cannot be cut into calls marks the
// ends of its slices with giveWay().
//
// While others have work, previews take no more than their share of the time (setPreviewShare): each has to
// be earned by the work of others first, at most kMostEarned ahead.
//
// Thread rule: submit from any thread but its own (waiting for a job inside a job would never end). Objects
// made with the context are used and destroyed inside jobs.
//
// When the context is lost the running job fails, the thread makes a new one, and generation() grows. Objects
// of an earlier generation are empty: their owner compares generations in its next job and builds them again.
class GlThread {
 public:
  static constexpr std::chrono::milliseconds kPatience{250};
  static constexpr std::chrono::milliseconds kMostEarned{500};

  // Unsupported or Unavailable when there is no context.
  [[nodiscard]] static Result<std::unique_ptr<GlThread>> start(const ContextOptions& options = {});
  ~GlThread();  // the running slice ends; waiting jobs fail with Unavailable
  GlThread(const GlThread&) = delete;
  GlThread& operator=(const GlThread&) = delete;

  // A job of one slice: `work(Context&)` returns a Result. An exception passes through the future.
  template <typename Work>
  [[nodiscard]] auto submit(Priority priority, std::string name, Work work)
      -> std::future<std::invoke_result_t<Work&, Context&>> {
    using R = std::invoke_result_t<Work&, Context&>;
    auto promise = std::make_shared<std::promise<R>>();
    auto future = promise->get_future();
    enqueue(priority, {std::move(name),
                       [promise, work = std::move(work)](Context& context, const SliceClock&) mutable {
                         try {
                           promise->set_value(work(context));
                         } catch (...) {
                           promise->set_exception(std::current_exception());
                         }
                         return true;
                       },
                       [promise](const Error& error) { promise->set_value(tl::unexpected(error)); },
                       {}});
    return future;
  }

  // A long job: `work` is called until it returns true (done) or an error; each call should end when the
  // clock is over.
  using SlicedWork = std::function<Result<bool>(Context&, const SliceClock&)>;
  [[nodiscard]] std::future<Result<void>> submitSliced(Priority priority, std::string name, SlicedWork work);

  // The end of a slice within a job of a lower priority than Preview: previews that wait and have their share
  // run here and now, on the same context. Every draw names all of its state, so between two draws nothing
  // but the contents of shared textures may differ afterwards. Cheap when no preview waits. Only on the GL
  // thread, inside such a job.
  void giveWay();

  // 0: previews run only while nothing else waits; 1 (at the start): they come first. Any thread.
  void setPreviewShare(double share);

  [[nodiscard]] DeviceInfo info() const;
  [[nodiscard]] GlThreadStats stats() const;
  [[nodiscard]] std::uint64_t generation() const { return generation_.load(); }

 private:
  struct Job {
    std::string name;
    std::function<bool(Context&, const SliceClock&)> slice;  // true: done
    std::function<void(const Error&)> cancel;
    std::chrono::steady_clock::time_point since;  // waiting since
  };

  explicit GlThread(const ContextOptions& options) : options_(options) {}
  void enqueue(Priority priority, Job job);
  void serve(const std::stop_token& stop, std::promise<Result<void>> started);
  [[nodiscard]] std::optional<std::pair<int, Job>> take(const std::stop_token& stop);
  void runSlice(Context& context, int priority, Job job);
  // With the mutex held: a slice of `priority` has ended now.
  void account(int priority, const std::string& name, std::chrono::steady_clock::time_point begin);
  [[nodiscard]] bool othersWait() const;
  [[nodiscard]] bool previewMayRun() const { return preview_share_ >= 1 || earned_.count() > 0; }
  [[nodiscard]] Result<void> ensureContext(std::optional<Context>& context);

  ContextOptions options_;
  mutable std::mutex mutex_;
  std::condition_variable_any wake_;
  std::array<std::deque<Job>, kPriorities> queues_;
  GlThreadStats stats_;
  DeviceInfo info_;
  double preview_share_ = 1;
  std::chrono::nanoseconds earned_{0};  // time that previews may take while others wait
  bool nested_ = false;                 // a preview runs within another job
  // Of the running slice; on the GL thread alone.
  Context* running_context_ = nullptr;
  int running_priority_ = 0;
  std::string running_name_;
  std::chrono::steady_clock::time_point slice_begin_;
  std::atomic<std::uint64_t> generation_{0};
  bool closed_ = false;
  std::jthread thread_;  // last: joins before what it uses goes
};

}  // namespace overfly::gl
