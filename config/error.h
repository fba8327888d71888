#pragma once
#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace overfly {

// What went wrong, in a form that a caller can act on. The message is one sentence for a person and says
// what to do; the code is for programs.
enum class ErrorCode {
  BadSettings,  // the user must change a setting; start-up ends (exit status 2)
  BadInput,     // a file, frame, packet or request that cannot be used as it is
  NotFound,     // absent, which is not the same as damaged
  Corrupt,      // was written by us and no longer reads back whole
  Io,           // the operating system refused: disk full, permission, device gone
  Unsupported,  // known, but not on this machine or in this build
  Unavailable,  // may come back: camera unplugged, context lost, no pose yet
  Internal,     // a broken assumption of our own
};

struct Error {
  ErrorCode code = ErrorCode::Internal;
  std::string message;
};

template <typename T>
using Result = tl::expected<T, Error>;

[[nodiscard]] inline tl::unexpected<Error> fail(ErrorCode code, std::string message) {
  return tl::unexpected<Error>(Error{code, std::move(message)});
}

}  // namespace overfly
