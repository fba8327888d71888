#include <fmt/format.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <systemd/sd-daemon.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <csignal>
#include <ctime>
#include <optional>

#include "config/load.h"
#include "daemon/link/link_server.h"
#include "daemon/overflyd/backend.h"
#include "daemon/overflyd/options.h"
#include "daemon/overflyd/pipeline.h"

namespace {

using namespace overfly;

constexpr int kFailed = 1;
constexpr int kBadSettings = 2;

int exitStatus(const Error& error) {
  fmt::print(stderr, "overflyd: {}\n", error.message);
  return error.code == ErrorCode::BadSettings ? kBadSettings : kFailed;
}

// A mission that was not ended is taken up again; else a new one is named by the time.
std::string missionIn(const std::filesystem::path& root) {
  std::error_code code;
  std::string newest;
  for (const auto& entry : std::filesystem::directory_iterator(root, code))
    if (entry.is_directory()) newest = std::max(newest, entry.path().filename().string());
  if (!newest.empty() && !std::filesystem::exists(root / newest / "ended")) return newest;
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char name[32];
  std::strftime(name, sizeof name, "%Y%m%dT%H%M%SZ", &utc);
  return name;
}

// Systemd's watchdog is fed while the pipeline gets on, or has proven that it has nothing to do.
class Watchdog {
 public:
  void look(const daemon::Pipeline& pipeline, const daemon::PipelineStatus& status) {
    const std::uint64_t progress = pipeline.progress();
    const bool waits_for_frames = !status.settled && status.waiting_frames == 0;
    if (progress != last_ || status.idle || waits_for_frames) sd_notify(0, "WATCHDOG=1");
    last_ = progress;
  }

 private:
  std::uint64_t last_ = 0;
};

int run(const std::optional<std::filesystem::path>& file, const std::vector<std::string>& overrides,
        bool exit_when_done) {
  config::Sources sources = config::installedSources("/etc/overfly", file);
  sources.overrides = overrides;
  const auto loaded = config::load(sources);
  if (!loaded) return exitStatus(config::errorFrom(loaded.error()));
  const config::Settings& settings = loaded->settings;
  spdlog::set_default_logger(spdlog::stderr_logger_mt("overflyd"));
  spdlog::set_pattern("%l: %v");

  auto source = daemon::makeSource(settings);
  if (!source) return exitStatus(source.error());

  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals, signal);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  const std::filesystem::path root = settings.map.folder;
  const std::string mission = missionIn(root);
  daemon::Pipeline pipeline(settings, std::move(*source), root / mission);
  const auto backend = std::make_shared<daemon::Backend>(root, mission, pipeline);
  link::LinkServer server(link::optionsFrom(settings.link), backend);
  pipeline.onCommit([&server] { server.mapChanged(); });
  if (settings.link.enabled) {
    if (auto ok = server.start(); !ok) return exitStatus(ok.error());
    // The token in the address is for the operator's eyes: it goes to the terminal, not to a log.
    if (!settings.link.require_token || link::isLoopback(settings.link.listen))
      fmt::print("{}\n", server.url());
    std::fflush(stdout);
  }
  if (auto ok = pipeline.start(); !ok) return exitStatus(ok.error());
  sd_notify(0, "READY=1");

  Watchdog watchdog;
  int status_code = 0;
  for (;;) {
    const timespec second{1, 0};
    const int signal = sigtimedwait(&signals, nullptr, &second);
    if (signal == SIGINT || signal == SIGTERM) break;
    if (signal == SIGHUP) spdlog::warn("SIGHUP: no setting that can change while running has changed");
    const daemon::PipelineStatus status = pipeline.status();
    watchdog.look(pipeline, status);
    sd_notify(0, fmt::format("STATUS={} frames, {} mapped, {} tiles, lag {:.1f} s", status.seen,
                             status.mapped, status.tiles, status.lag_s)
                     .c_str());
    if (status.failed) {
      status_code = kFailed;
      break;
    }
    if (exit_when_done && status.source_ended && status.idle) break;
  }
  sd_notify(0, "STOPPING=1");
  const bool done = pipeline.status().source_ended && pipeline.status().idle;
  server.stop();
  pipeline.stop();
  if (done) {
    std::FILE* ended = std::fopen((root / mission / "ended").c_str(), "w");
    if (ended != nullptr) std::fclose(ended);
  }
  return status_code;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Maps while the drone flies: frames with pose in, tiles out.", "overflyd");
  std::string file;
  std::vector<std::string> overrides;
  bool exit_when_done = false;
  app.add_option("--config", file, "settings file instead of /etc/overfly/overfly.toml and conf.d");
  app.add_option("--set", overrides, "section.key=value over all files");
  app.add_flag("--exit-when-done", exit_when_done, "end when the source has ended and everything is mapped");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const int code = app.exit(error);
    return code == 0 ? 0 : kBadSettings;
  }
  return run(file.empty() ? std::nullopt : std::optional<std::filesystem::path>(file), overrides,
             exit_when_done);
}
