#pragma once
#include <cstddef>
#include <cstdint>
#include <deque>

namespace overfly::daemon {

// Times from the shutter to the first commit of a tile that shows the frame: committed is what the link
// serves. Of each frame once, when its provisional tiles are there, and once, when a swept tile has it among
// its frames. Not thread-safe.
class Latency {
 public:
  struct Sight {
    std::int64_t shutter_ns = 0;  // CLOCK_BOOTTIME
    bool swept = false;
  };
  struct Summary {
    std::size_t frames = 0;
    double last = 0, median = 0, p95 = 0;  // seconds, of the last kKept frames
  };
  static constexpr std::size_t kKept = 1000;

  void add(double seconds);
  [[nodiscard]] Summary summary() const;

 private:
  std::deque<double> last_;
  std::size_t frames_ = 0;
};

}  // namespace overfly::daemon
