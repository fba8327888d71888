#include <fmt/chrono.h>
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "daemon/cli/command.h"
#include "daemon/cli/daemon_client.h"

namespace overfly::cli {
namespace {

std::string dateOf(std::int64_t utc_ms) {
  return fmt::format("{:%Y-%m-%d %H:%M:%S} UTC", fmt::gmtime(static_cast<std::time_t>(utc_ms / 1000)));
}

Result<int> list(const Context& context, const std::string& url) {
  const auto daemon = daemonOf(context, url);
  if (!daemon) return tl::unexpected(daemon.error());
  const auto answer = askDaemon(*daemon, "GET", "/missions");
  if (!answer) return tl::unexpected(answer.error());
  const auto node = nlohmann::json::parse(*answer, nullptr, false);
  if (!node.is_object() || !node.contains("missions") || !node["missions"].is_array())
    return fail(ErrorCode::BadInput, "what answers there is not an overfly daemon");
  if (context.json) {
    fmt::print("{}\n", node.dump(2));
    return kOk;
  }
  if (node["missions"].empty()) fmt::print("no mission yet\n");
  for (const auto& mission : node["missions"])
    fmt::print("{:<32} {}{}{}\n", mission.value("id", ""), dateOf(mission.value("started_utc_ms", 0LL)),
               mission.value("live", false) ? "  live" : "",
               mission.value("current", false) ? "  shown" : "");
  return kOk;
}

Result<int> start(const Context& context, const std::string& url, const std::string& name) {
  const auto daemon = daemonOf(context, url);
  if (!daemon) return tl::unexpected(daemon.error());
  const auto answer = askDaemon(*daemon, "POST", "/missions", nlohmann::json{{"name", name}}.dump());
  if (!answer) return tl::unexpected(answer.error());
  const auto node = nlohmann::json::parse(*answer, nullptr, false);
  if (context.json)
    fmt::print("{}\n", node.dump(2));
  else
    fmt::print("mission {} takes frames now\n", node.is_object() ? node.value("id", "") : "");
  return kOk;
}

Result<int> stop(const Context& context, const std::string& url) {
  const auto daemon = daemonOf(context, url);
  if (!daemon) return tl::unexpected(daemon.error());
  const auto answer = askDaemon(*daemon, "DELETE", "/missions");
  if (!answer) return tl::unexpected(answer.error());
  if (context.json)
    fmt::print("{{}}\n");
  else
    fmt::print("the mission takes no more frames; what was recorded is mapped to its end\n");
  return kOk;
}

void build(CLI::App& command, Context& context) {
  auto url = std::make_shared<std::string>();
  auto name = std::make_shared<std::string>();
  const auto withUrl = [&](CLI::App* sub) {
    sub->add_option("--url", *url, "address of the daemon's link; else that of the settings");
    return sub;
  };
  context.onRun(*withUrl(command.add_subcommand("list", "all missions of the daemon, the newest last")),
                [url, &context] { return list(context, *url); });
  CLI::App* begin = withUrl(command.add_subcommand(
      "start", "begins a mission: a map and a recorded flight of its own, fed by the daemon's source"));
  begin->add_option("NAME", *name, "letters, digits, '-', '_', '.'; else the time in UTC");
  context.onRun(*begin, [url, name, &context] { return start(context, *url, *name); });
  context.onRun(
      *withUrl(command.add_subcommand("stop", "ends the live mission; its map is finished behind it")),
      [url, &context] { return stop(context, *url); });
  command.require_subcommand(1);
}

const Registered registered{"mission", "starts, stops and lists the daemon's missions", build};

}  // namespace
}  // namespace overfly::cli
