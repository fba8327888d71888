#pragma once
#include <cstdint>
#include <optional>

namespace overfly::capture {

// A driver's 32-bit frame numbers made 64 bits long, through overflows, restarts of the driver's count and
// re-plugged cameras (CameraSource says what is promised). Value type.
class FrameNumbers {
 public:
  // The driver begins to count anew. What was missed meanwhile is unknown: the gap is one.
  void restart() { last_driver_.reset(); }

  // The frame that the driver calls so. A number that does not go on from the last one (drivers that always
  // say 0, or begin again by themselves) counts as the next.
  std::uint64_t take(std::uint32_t driver) {
    if (!last_driver_) {
      next_ += last_driver_ever_ ? 1 : 0;
    } else {
      const std::uint32_t step = driver - *last_driver_;
      if (step > 1 && step < kLargestStep) {
        dropped_ += step - 1;
        next_ += step - 1;
      }
    }
    last_driver_ = driver;
    last_driver_ever_ = true;
    return next_++;
  }

  // Frames that the driver counted and did not hand over.
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }

 private:
  // Further ahead than this is not a gap but a count that has begun again.
  static constexpr std::uint32_t kLargestStep = 1u << 20;

  std::optional<std::uint32_t> last_driver_;
  bool last_driver_ever_ = false;
  std::uint64_t next_ = 0;
  std::uint64_t dropped_ = 0;
};

}  // namespace overfly::capture
