#pragma once
#include <time.h>

#include <cstdint>

namespace overfly::daemon {

// CLOCK_BOOTTIME, nanoseconds.
[[nodiscard]] inline std::int64_t now_ns() {
  timespec t{};
  clock_gettime(CLOCK_BOOTTIME, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

}  // namespace overfly::daemon
