#include "daemon/overflyd/stage.h"

#include <fmt/format.h>

#include <charconv>
#include <stdexcept>
#include <thread>

namespace overfly::daemon {
namespace {

std::optional<std::uint64_t> numberIn(std::string_view text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace

Result<StageHook> parseStageHook(std::string_view text) {
  const auto wrong = [&] {
    return fail(ErrorCode::BadSettings,
                fmt::format("{}: a fault is STAGE:slow:MS, STAGE:stuck or STAGE:throw, with @N for the N-th "
                            "piece of work; STAGE is capture, adjusting, mapping or encoding",
                            text));
  };
  std::uint64_t from = 0;
  std::string_view rest = text;
  if (const auto at = rest.find('@'); at != std::string_view::npos) {
    const auto number = numberIn(rest.substr(at + 1));
    if (!number) return wrong();
    from = *number;
    rest = rest.substr(0, at);
  }
  const auto colon = rest.find(':');
  if (colon == std::string_view::npos) return wrong();
  std::optional<Stage> stage;
  for (std::size_t i = 0; i < kStageNames.size(); ++i)
    if (kStageNames[i] == rest.substr(0, colon)) stage = static_cast<Stage>(i);
  if (!stage) return wrong();
  const std::string_view kind = rest.substr(colon + 1);
  std::function<void()> fault;
  if (kind == "stuck") {
    fault = [] {
      for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
    };
  } else if (kind == "throw") {
    fault = [] { throw std::runtime_error("a fault was asked for"); };
  } else if (kind.starts_with("slow:")) {
    const auto ms = numberIn(kind.substr(5));
    if (!ms) return wrong();
    fault = [pause = std::chrono::milliseconds(*ms)] { std::this_thread::sleep_for(pause); };
  } else {
    return wrong();
  }
  return [stage = *stage, from, fault = std::move(fault)](Stage where, std::uint64_t count) {
    if (where == stage && count >= from) fault();
  };
}

}  // namespace overfly::daemon
