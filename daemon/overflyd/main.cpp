#include <fmt/format.h>
#include <fmt/ranges.h>
#include <malloc.h>
#include <spdlog/spdlog.h>
#include <systemd/sd-daemon.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <csignal>
#include <ctime>
#include <optional>

#include "config/description.h"
#include "config/load.h"
#include "daemon/cli/daemon_command_line.h"
#include "daemon/link/link_server.h"
#include "daemon/overflyd/backend.h"
#include "daemon/overflyd/log.h"
#include "daemon/overflyd/missions.h"
#include "daemon/overflyd/onboard_view.h"
#include "daemon/overflyd/options.h"
#include "render/gl/gpu_options.h"

namespace {

using namespace overfly;

constexpr int kFailed = 1;
constexpr int kBadSettings = 2;

using Arguments = cli::DaemonArguments;

int exitStatus(const Error& error) {
  fmt::print(stderr, "overflyd: {}\n", error.message);
  return error.code == ErrorCode::BadSettings ? kBadSettings : kFailed;
}

tl::expected<config::Loaded, config::Problems> loadSettings(const Arguments& arguments) {
  const auto file = arguments.config_file.empty()
                        ? std::nullopt
                        : std::optional<std::filesystem::path>(arguments.config_file);
  config::Sources sources = config::installedSources("/etc/overfly", file);
  sources.overrides = arguments.overrides;
  return config::load(sources);
}

// SIGHUP: what may change while running changes, what may not is named, and wrong settings change nothing.
void reload(const Arguments& arguments, config::Settings& settings, gl::GlThread& gl,
            link::LinkServer& server, daemon::OnboardView& view, daemon::Missions& missions) {
  sd_notify(0, "RELOADING=1");
  const auto loaded = loadSettings(arguments);
  if (!loaded) {
    spdlog::error("the settings stay as they are: {}", config::errorFrom(loaded.error()).message);
  } else {
    std::vector<std::string> taken, later;
    config::Settings next = settings;
    for (const config::Key* key : config::differences(settings, loaded->settings)) {
      if (key->live) key->set(next, key->get(loaded->settings));
      (key->live ? taken : later).push_back(key->path());
    }
    settings = next;
    daemon::setLogLevel(settings.log.level);
    gl.setPreviewShare(settings.preview.gpu_share);
    view.reload(settings.preview);
    server.setMaxKbps(settings.link.max_kbps);
    missions.reload(settings);
    spdlog::info("settings read again: {}", taken.empty() ? "none has changed that may change while running"
                                                          : fmt::format("{}", fmt::join(taken, ", ")));
    if (!later.empty()) spdlog::warn("these count from the next start: {}", fmt::join(later, ", "));
  }
  sd_notify(0, "READY=1");
}

// What systemd shows, and its watchdog: fed while every stage gets on or has found that it has nothing to do.
void report(const daemon::Missions& missions) {
  static std::string told;
  std::vector<std::string> stuck;
  for (const auto& pipeline : missions.running())
    for (const std::string& stage : pipeline->status().stuck) stuck.push_back(stage);
  const std::string stages = fmt::format("{}", fmt::join(stuck, ", "));
  if (stuck.empty()) {
    sd_notify(0, "WATCHDOG=1");
  } else if (stages != told) {
    spdlog::error("stuck: {}; the watchdog is not fed any more", stages);
  }
  told = stages;
  const auto current = missions.current();
  if (!current) {
    sd_notify(0, "STATUS=no mission; waiting for one to start");
    return;
  }
  const daemon::PipelineStatus status = current->status();
  sd_notify(0, fmt::format("STATUS={}: {} frames, {} mapped, {} tiles, lag {:.1f} s{}{}",
                           missions.currentName(), status.seen, status.mapped, status.tiles, status.lag_s,
                           status.store_problem.empty() ? "" : "; " + status.store_problem,
                           stuck.empty() ? "" : "; stuck: " + stages)
                   .c_str());
}

int run(const Arguments& arguments) {
  const auto loaded = loadSettings(arguments);
  if (!loaded) return exitStatus(config::errorFrom(loaded.error()));
  config::Settings settings = loaded->settings;
  daemon::startLog(settings.log.level);
  daemon::StageHook fault;
  daemon::GpuHook gpu_fault;
  if (!arguments.fault.empty()) {
    if (arguments.fault.starts_with("gpu:")) {
      auto parsed = daemon::parseGpuHook(arguments.fault);
      if (!parsed) return exitStatus(parsed.error());
      gpu_fault = std::move(*parsed);
    } else {
      auto parsed = daemon::parseStageHook(arguments.fault);
      if (!parsed) return exitStatus(parsed.error());
      fault = std::move(*parsed);
    }
    spdlog::warn("a fault is injected for a test: {}", arguments.fault);
  }
  const auto make_source = [settings] { return daemon::makeSource(settings); };
  // A source that this build does not have is found now, not at the first mission.
  if (const auto source = make_source(); !source) return exitStatus(source.error());

  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals, signal);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  auto gl = gl::GlThread::start(gl::optionsFrom(settings.gpu));
  if (!gl) return exitStatus(gl.error());
  (*gl)->setPreviewShare(settings.preview.gpu_share);
  const gl::DeviceInfo gpu = (*gl)->info();
  spdlog::info("GPU: {}{}", gpu.renderer, gpu.node.empty() ? "" : fmt::format(" ({})", gpu.node));

  std::atomic<link::LinkServer*> shown{nullptr};  // for commits that come before and after the link's time
  daemon::Missions missions(settings, **gl, make_source, [&shown] {
    if (link::LinkServer* server = shown) server->mapChanged();
  });
  missions.setStageHook(fault);
  missions.setGpuHook(gpu_fault);
  daemon::OnboardView view(settings.preview, **gl);
  link::LinkOptions link_options = link::optionsFrom(settings.link);
  link_options.coverage_views = settings.plan.min_views;
  link::LinkServer server(link_options, std::make_shared<daemon::Backend>(missions, view));
  if (settings.link.enabled) {
    if (auto ok = server.start(); !ok) return exitStatus(ok.error());
    // The token in the address is for the operator's eyes: it goes to the terminal, not to a log.
    if (!settings.link.require_token || link::isLoopback(settings.link.listen))
      fmt::print("{}\n", server.url());
    std::fflush(stdout);
    shown = &server;
  }
  const auto stop = [&] {
    shown = nullptr;
    server.stop();
    missions.shutDown();
  };
  auto live = missions.resume();
  if (live && !*live && settings.mission.start == config::MissionStart::Boot) {
    if (auto started = missions.start(); !started) live = tl::unexpected(started.error());
  }
  if (!live) {
    stop();
    return exitStatus(live.error());
  }
  sd_notify(0, "READY=1");

  int status_code = 0;
  for (;;) {
    const timespec second{1, 0};
    const int signal = sigtimedwait(&signals, nullptr, &second);
    if (signal == SIGINT || signal == SIGTERM) break;
    if (signal == SIGHUP) reload(arguments, settings, **gl, server, view, missions);
    report(missions);
    for (const auto& pipeline : missions.running())
      if (const daemon::PipelineStatus status = pipeline->status(); status.failed)
        status_code = status.bad_settings ? kBadSettings : kFailed;
    if (status_code != 0) break;
    (void)missions.tidy();
    if (arguments.exit_when_done && missions.running().empty()) break;
  }
  sd_notify(0, "STOPPING=1");
  stop();
  return status_code;
}

// A daemon for a whole day: with glibc's defaults the pictures that come and go leave holes in one heap per
// thread, and it takes more memory with each frame. Blocks as large as pictures are given back to the system
// at once, for some CPU time, and threads share two heaps (tests/stress/daemon/soak_test.cpp).
void keepHeapSmall() {
#ifdef __GLIBC__
  mallopt(M_ARENA_MAX, 2);
  mallopt(M_MMAP_THRESHOLD, 256 << 10);
  mallopt(M_TRIM_THRESHOLD, 32 << 20);
#endif
}

}  // namespace

int main(int argc, char** argv) {
  keepHeapSmall();
  CLI::App app;
  cli::DaemonArguments arguments;
  cli::buildDaemonCommandLine(app, arguments);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const int code = app.exit(error);
    return code == 0 ? 0 : kBadSettings;
  }
  return run(arguments);
}
