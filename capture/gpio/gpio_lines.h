#pragma once
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "capture/record/raw_log.h"
#include "config/error.h"

namespace overfly::capture {

struct LineWanted {
  unsigned line = 0;
  bool rising = true;  // which edge counts
};

// Input lines of a GPIO chip whose edges the kernel stamps. Move-only through a pointer; thread-bound.
class EdgeLines {
 public:
  // `chip`: "gpiochip0" or "/dev/gpiochip0". Unavailable: no such chip (now); NotFound: no such line on it;
  // Io: permission denied, or a line is in use (says by whom). Unsupported: built without libgpiod.
  [[nodiscard]] static Result<std::unique_ptr<EdgeLines>> open(const std::string& chip,
                                                               const std::vector<LineWanted>& lines);
  virtual ~EdgeLines() = default;
  EdgeLines() = default;
  EdgeLines(const EdgeLines&) = delete;
  EdgeLines& operator=(const EdgeLines&) = delete;

  // Edges that have come, in order; none when `timeout` passed. edge_ns is on CLOCK_BOOTTIME: the kernel's
  // CLOCK_MONOTONIC stamp plus the difference of both clocks now, which only changes while the machine
  // sleeps. Unavailable: the chip is gone.
  [[nodiscard]] virtual Result<std::vector<GpioEdge>> wait(std::chrono::milliseconds timeout) = 0;
};

// One output line. Released (and left to the kernel) when it is destroyed.
class OutputLine {
 public:
  // Starts low. Errors as above.
  [[nodiscard]] static Result<std::unique_ptr<OutputLine>> open(const std::string& chip, unsigned line);
  virtual ~OutputLine() = default;
  OutputLine() = default;
  OutputLine(const OutputLine&) = delete;
  OutputLine& operator=(const OutputLine&) = delete;
  [[nodiscard]] virtual Result<void> set(bool high) = 0;
};

// "1.6", "2.1", or "none": the libgpiod that this was built with.
[[nodiscard]] const char* gpioLibrary();

}  // namespace overfly::capture
