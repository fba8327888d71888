#pragma once
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "config/error.h"

namespace overfly::daemon {

// The stages of a pipeline, each a thread of its own, in the order of the frames' way.
enum class Stage { Capture, Adjusting, Mapping, Encoding };
inline constexpr std::array<std::string_view, 4> kStageNames{"capture", "adjusting", "mapping", "encoding"};

// When a stage last got on: its own thread says so when it has done a piece of work, or has found that there
// is none. Nobody else does, so a stage that hangs falls silent; one that has not begun is excused.
// Thread-safe.
class Heartbeat {
 public:
  using Clock = std::chrono::steady_clock;
  void beat() { last_ = Clock::now().time_since_epoch().count(); }
  // The stage is about to do something of which nobody can say how long it takes (reading a flight's table).
  void excuse() { last_ = Clock::time_point::max().time_since_epoch().count(); }
  [[nodiscard]] std::chrono::nanoseconds silence() const {
    return Clock::now() - Clock::time_point(Clock::duration(last_.load()));
  }

 private:
  std::atomic<Clock::rep> last_{Clock::time_point::max().time_since_epoch().count()};
};

// How a stage is made to fail on purpose, for tests: called by each stage's thread before each piece of work,
// `count` pieces after its start. May wait, and may throw.
using StageHook = std::function<void(Stage stage, std::uint64_t count)>;

// A hook from text: "STAGE:slow:MS", "STAGE:stuck", "STAGE:throw", each with "@N" behind it to begin with the
// N-th piece of work. BadSettings: not of that form.
[[nodiscard]] Result<StageHook> parseStageHook(std::string_view text);

// How long a stage may be silent before systemd's watchdog is not fed any more.
inline constexpr std::chrono::seconds kStageSilence{15};

}  // namespace overfly::daemon
