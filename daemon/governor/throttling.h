#pragma once
#include <filesystem>
#include <string>

namespace overfly::daemon {

// What the kernel says of heat. Plain value.
struct Throttling {
  double headroom = 1;  // share of the processor's full speed that is left; 1: cool, or nothing is known
  std::string reason;   // for people; empty at 1
};

// Reads the kernel's cooling devices and frequency limits (and, on a Raspberry Pi, what its firmware reports)
// below `sys`. Costs some file reads: every few seconds is enough. Never fails: what cannot be read is left
// out. Reentrant.
[[nodiscard]] Throttling readThrottling(const std::filesystem::path& sys = "/sys");

}  // namespace overfly::daemon
