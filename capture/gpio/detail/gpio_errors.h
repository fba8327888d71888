#pragma once
#include <cstdint>
#include <string>

#include "config/error.h"

namespace overfly::capture::detail {

// "gpiochip0" as "/dev/gpiochip0".
[[nodiscard]] std::string chipPath(const std::string& chip);

// What the system said when a chip was opened, in a sentence that says what to do.
[[nodiscard]] tl::unexpected<Error> chipFailure(const std::string& path, int code);
// The same for a line that was asked for; `user`: who has it, where the kernel says.
[[nodiscard]] tl::unexpected<Error> lineFailure(const std::string& path, unsigned line, int code,
                                                const std::string& user);
[[nodiscard]] tl::unexpected<Error> noSuchLine(const std::string& path, unsigned line, unsigned lines);
[[nodiscard]] tl::unexpected<Error> chipGone(const std::string& path, int code);

// Add to a CLOCK_MONOTONIC stamp for CLOCK_BOOTTIME, ns.
[[nodiscard]] std::int64_t boottimeFromMonotonic();
[[nodiscard]] std::int64_t boottimeNow();

}  // namespace overfly::capture::detail
