#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "daemon/cli/command.h"
#include "daemon/cli/daemon_client.h"

namespace overfly::cli {
namespace {

using Clock = std::chrono::steady_clock;
using nlohmann::json;

// A number in a document that somebody else wrote; 0 where it is missing.
double numberAt(const json& status, const char* path) {
  const json::json_pointer pointer(path);
  return status.contains(pointer) && status[pointer].is_number() ? status[pointer].get<double>() : 0;
}

std::string line(const json& status) {
  return fmt::format(
      "{}: {:.0f} frames, {:.0f} mapped, {:.0f} tiles written, {:.2f} ha, {:.0f} cells wait, lag "
      "{:.1f} s",
      status.value("state", "?"), numberAt(status, "/frames/seen"), numberAt(status, "/frames/mapped"),
      numberAt(status, "/tiles/written"), numberAt(status, "/survey/area_m2") / 1e4,
      numberAt(status, "/tiles/waiting_cells"), numberAt(status, "/lag_s"));
}

void printSummary(const json& status, double wall_s, double after_s) {
  const double cells = std::max(numberAt(status, "/cells/seen"), 1.0);
  const double mapped = numberAt(status, "/frames/mapped");
  fmt::print("\narea    {:.2f} ha at {:.1f} cm a texel\n", numberAt(status, "/survey/area_m2") / 1e4,
             100 * numberAt(status, "/survey/gsd_m"));
  fmt::print(
      "tiles   {:.0f} written, updates counted; {:.0f} cells, {:.1f} sweeps and {:.1f} orthophotos each\n",
      numberAt(status, "/tiles/written"), numberAt(status, "/cells/seen"),
      numberAt(status, "/cells/swept") / cells, numberAt(status, "/cells/finished") / cells);
  fmt::print(
      "time    {:.0f} of {:.0f} frames mapped in {:.1f} s, {:.2f} s a frame; {:.1f} s of it after the last "
      "frame\n",
      mapped, numberAt(status, "/frames/seen"), wall_s, wall_s / std::max(mapped, 1.0), after_s);
  for (const auto& [kind, what] : {std::pair("provisional", "first tile of new ground"),
                                   std::pair("swept", "first swept tile of a frame")}) {
    const std::string path = fmt::format("/latency/{}", kind);
    if (numberAt(status, (path + "/frames").c_str()) == 0) continue;
    fmt::print("latency {:.2f} s (median), {:.2f} s (95 %) from the shutter to the {} on the link\n",
               numberAt(status, (path + "/median_s").c_str()), numberAt(status, (path + "/p95_s").c_str()),
               what);
  }
  if (status.contains("quality") && status["quality"].is_object()) {
    const json& quality = status["quality"];
    fmt::print(
        "quality {}: point {:.0f} of {:.0f} at the end, {:.0f} changes, {:.0f} cells left to improve\n",
        quality.value("mode", "?"), numberAt(quality, "/index"), numberAt(quality, "/points"),
        numberAt(quality, "/changes"), numberAt(quality, "/to_improve"));
  }
  std::vector<std::pair<double, std::string>> stages;
  if (status.contains("stages_s"))
    for (const auto& [name, seconds] : status["stages_s"].items())
      if (seconds.is_number()) stages.emplace_back(seconds.get<double>(), name);
  std::sort(stages.rbegin(), stages.rend());
  std::vector<std::string> words;
  for (const auto& [seconds, name] : stages) words.push_back(fmt::format("{} {:.1f} s", name, seconds));
  fmt::print("stages  {}\n", fmt::join(words, ", "));
}

Result<int> show(const Context& context, const std::string& url, bool watch) {
  const auto daemon = daemonOf(context, url);
  if (!daemon) return tl::unexpected(daemon.error());
  const auto start = Clock::now();
  const auto elapsed = [&] { return std::chrono::duration<double>(Clock::now() - start).count(); };
  std::optional<double> landed_s;
  for (auto next = start;; next += std::chrono::seconds(1)) {
    std::this_thread::sleep_until(next);
    const auto answer = askDaemon(*daemon, "GET", "/status");
    if (!answer) return tl::unexpected(answer.error());
    const json status = json::parse(*answer, nullptr, false);
    if (!status.is_object()) return fail(ErrorCode::BadInput, "what answers there is not an overfly daemon");
    if (context.json)
      fmt::print("{}\n", status.dump(watch ? -1 : 2));
    else
      fmt::print("{}{}\n", watch ? fmt::format("{:6.1f} s  ", elapsed()) : std::string(), line(status));
    std::fflush(stdout);
    if (!watch) return kOk;
    const std::string state = status.value("state", "");
    if (state == "failed") return fail(ErrorCode::Unavailable, status.value("problem", "the daemon gave up"));
    const bool ended = status.contains("source") && status["source"].value("ended", false);
    if (ended && !landed_s) landed_s = elapsed();
    if (!ended || state != "idle") continue;
    if (!context.json) printSummary(status, elapsed(), elapsed() - *landed_s);
    return kOk;
  }
}

void build(CLI::App& command, Context& context) {
  auto url = std::make_shared<std::string>();
  auto watch = std::make_shared<bool>(false);
  command.add_option("--url", *url, "address of the daemon's link; else that of the settings");
  command.add_flag("--watch", *watch,
                   "a line a second until the mission is mapped to its end, and then a summary");
  context.onRun(command, [url, watch, &context] { return show(context, *url, *watch); });
}

const Registered registered{"status", "how far the daemon is: frames, tiles, lag", build};

}  // namespace
}  // namespace overfly::cli
