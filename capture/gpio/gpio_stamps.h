#pragma once
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "capture/gpio/gpio_lines.h"

namespace overfly::capture {

// Drops edges that follow an accepted one of the same line too soon: a contact that bounces, a ringing cable.
// The first edge of a burst is the true one. Thread-bound.
class Debouncer {
 public:
  explicit Debouncer(std::int64_t quiet_ns) : quiet_ns_(quiet_ns) {}
  // False: drop it.
  [[nodiscard]] bool accept(const GpioEdge& edge);

 private:
  std::int64_t quiet_ns_;
  std::map<std::uint32_t, std::int64_t> last_ns_;  // accepted, by line
};

struct GpioStampsOptions {
  std::string chip;
  std::optional<LineWanted> exposure, pps;
  std::int64_t debounce_ns =
      200'000;  // raising it drops wilder bouncing, and pulses that really come so fast
  std::chrono::milliseconds retry{1000};
};

struct GpioStatus {
  bool open = false;
  std::string problem;  // one sentence for a person while it is not; empty otherwise
  std::uint64_t exposures = 0, pps = 0, bounced = 0, reopened = 0;
  std::uint64_t problems = 0;  // that `problem` told, one after the other
};

// The thread that waits for edges. It opens the lines, again and again while that fails. Public calls from
// any thread.
class GpioStamps {
 public:
  // Called on this thread; must return at once. Times: CLOCK_BOOTTIME, ns.
  struct Listeners {
    std::function<void(const RawInput&)> raw;  // every edge, bouncing included
    std::function<void(std::int64_t edge_ns)> exposure, pps;
    // All edges up to here have been told.
    std::function<void(std::int64_t until_ns)> quiet;
  };
  // `open` stands for EdgeLines::open(options.chip, ...) where edges come from elsewhere.
  using Open = std::function<Result<std::unique_ptr<EdgeLines>>(const std::vector<LineWanted>&)>;

  GpioStamps(GpioStampsOptions options, Listeners listeners, Open open = {});
  ~GpioStamps();
  GpioStamps(const GpioStamps&) = delete;
  GpioStamps& operator=(const GpioStamps&) = delete;

  void start();
  void stop();
  [[nodiscard]] GpioStatus status() const;

 private:
  void run(const std::stop_token& stop);
  void serve(EdgeLines& lines, const std::stop_token& stop);

  const GpioStampsOptions options_;
  const Listeners listeners_;
  const Open open_;
  mutable std::mutex mutex_;
  GpioStatus status_;
  std::jthread thread_;
};

struct TriggerOptions {
  std::string chip;
  unsigned line = 0;
  std::chrono::nanoseconds interval{0};
  std::chrono::nanoseconds width{1'000'000};  // of a pulse
};

struct TriggerStatus {
  std::string problem;
  std::uint64_t pulses = 0;
  std::int64_t worst_late_ns = 0;  // of a pulse behind its due time, by the scheduler
};

// Releases the camera at a steady pace through an output line. Each pulse is due at a whole multiple of the
// interval after the first, so lateness does not add up.
class TriggerOutput {
 public:
  using Open = std::function<Result<std::unique_ptr<OutputLine>>()>;
  explicit TriggerOutput(TriggerOptions options, Open open = {});
  ~TriggerOutput();
  TriggerOutput(const TriggerOutput&) = delete;
  TriggerOutput& operator=(const TriggerOutput&) = delete;

  void start();
  void stop();
  [[nodiscard]] TriggerStatus status() const;

 private:
  void run(const std::stop_token& stop);

  const TriggerOptions options_;
  const Open open_;
  mutable std::mutex mutex_;
  TriggerStatus status_;
  std::jthread thread_;
};

}  // namespace overfly::capture
