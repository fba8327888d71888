#include "daemon/overflyd/gpu_fault.h"

#include <fmt/format.h>

#include <array>
#include <charconv>

namespace overfly::daemon {
namespace {

struct Kind {
  std::string_view prefix;
  void (gl::Context::*inject)();
  bool again;
};
constexpr std::array kKinds{Kind{"gpu:lost@", &gl::Context::injectLoss, true},
                            Kind{"gpu:memory@", &gl::Context::injectOutOfMemory, true},
                            Kind{"gpu:shader@", &gl::Context::injectShaderRefusal, false}};

}  // namespace

Result<GpuHook> parseGpuHook(std::string_view text) {
  for (const Kind& kind : kKinds) {
    if (!text.starts_with(kind.prefix)) continue;
    const std::string_view number = text.substr(kind.prefix.size());
    std::uint64_t at = 0;
    const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), at);
    if (error != std::errc() || end != number.data() + number.size() || at == 0) break;
    return [kind, at](gl::Context& context, std::uint64_t count) {
      if (kind.again ? count % at == 0 : count == at) (context.*kind.inject)();
    };
  }
  return fail(
      ErrorCode::BadSettings,
      fmt::format("{}: a fault of the GPU is gpu:lost@N, gpu:memory@N or gpu:shader@N, N a number of passes",
                  text));
}

}  // namespace overfly::daemon
