#include "capture/gpio/detail/gpio_errors.h"

#include <fmt/format.h>
#include <time.h>

#include <cerrno>
#include <cstring>

namespace overfly::capture::detail {
namespace {

std::int64_t now(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

tl::unexpected<Error> denied(const std::string& path) {
  return fail(ErrorCode::Io,
              fmt::format("{}: permission denied; add the service's user to the group that owns it "
                          "(gpio on most boards), as the udev rules of the package do",
                          path));
}

}  // namespace

std::string chipPath(const std::string& chip) { return chip.starts_with('/') ? chip : "/dev/" + chip; }

tl::unexpected<Error> chipFailure(const std::string& path, int code) {
  if (code == EACCES || code == EPERM) return denied(path);
  if (code == ENOENT)
    return fail(ErrorCode::Unavailable,
                fmt::format("{}: no such GPIO chip; gpiodetect lists those that there are", path));
  if (code == ENOTTY || code == ENODEV || code == EINVAL)
    return fail(ErrorCode::Unavailable,
                fmt::format("{}: not a GPIO chip; gpiodetect lists those that there are", path));
  return fail(ErrorCode::Unavailable, fmt::format("{}: cannot be opened: {}", path, std::strerror(code)));
}

tl::unexpected<Error> lineFailure(const std::string& path, unsigned line, int code, const std::string& user) {
  if (code == EACCES || code == EPERM) return denied(path);
  if (code == EBUSY) {
    return fail(ErrorCode::Io, fmt::format("{}: line {} is in use{}; free it, or choose another line", path,
                                           line, user.empty() ? "" : " by \"" + user + "\""));
  }
  return fail(ErrorCode::Io, fmt::format("{}: line {} cannot be had: {}", path, line, std::strerror(code)));
}

tl::unexpected<Error> noSuchLine(const std::string& path, unsigned line, unsigned lines) {
  return fail(ErrorCode::NotFound,
              fmt::format("{}: there is no line {}; it has {} (from 0 to {})", path, line, lines, lines - 1));
}

tl::unexpected<Error> chipGone(const std::string& path, int code) {
  return fail(ErrorCode::Unavailable, fmt::format("{} is gone: {}", path, std::strerror(code)));
}

std::int64_t boottimeNow() { return now(CLOCK_BOOTTIME); }

std::int64_t boottimeFromMonotonic() {
  const std::int64_t before = now(CLOCK_MONOTONIC), boot = now(CLOCK_BOOTTIME), after = now(CLOCK_MONOTONIC);
  return boot - (before + (after - before) / 2);
}

}  // namespace overfly::capture::detail
