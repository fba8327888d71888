#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "daemon/cli/command.h"
#include "daemon/cli/listen_address.h"
#include "daemon/link/link_server.h"
#include "daemon/pull/puller.h"

namespace overfly::cli {
namespace {

struct Arguments {
  std::string url, target, token_file, ca_file, serve;
  std::vector<std::string> layers;
  int connections = 4;
  bool once = false;
  double give_up_s = 0;
};

Result<std::string> readToken(const std::string& path) {
  std::ifstream in(path);
  std::string token;
  if (!std::getline(in, token) || token.empty())
    return fail(ErrorCode::BadSettings,
                "cannot read a token from " + path + "; it is the drone's link.token_file");
  return token;
}

nlohmann::json asJson(const pull::PullStatus& s) {
  return {{"mission", s.mission},
          {"map", s.map},
          {"mirror", s.mirror.string()},
          {"connected", s.connected},
          {"complete", s.complete},
          {"revision", s.revision},
          {"layers", s.layers},
          {"bytes", s.bytes},
          {"wanted", s.wanted},
          {"wanted_bytes", s.wanted_bytes},
          {"lag_s", s.lag_s},
          {"bytes_per_s", s.bytes_per_s},
          {"reconnects", s.reconnects},
          {"resumed_bytes", s.resumed_bytes},
          {"problem", s.problem}};
}

std::string asLine(const pull::PullStatus& s) {
  auto line = fmt::format(
      "{:.1f} MB, {} tile layers; {}; {:.0f} kbit/s", static_cast<double>(s.bytes) * 1e-6, s.layers,
      s.complete ? std::string("all there") : fmt::format("{} wanted, lag {:.0f} s", s.wanted, s.lag_s),
      s.bytes_per_s * 8e-3);
  if (s.reconnects > 0) line += fmt::format(", {} reconnects", s.reconnects);
  if (!s.problem.empty()) line += "; " + s.problem;
  return line;
}

// How far it is, on stderr: one line that is redrawn on a terminal, else a line when there is news, at most
// every ten seconds. With --json a line of JSON each second on stdout.
class Teller {
 public:
  explicit Teller(bool json) : json_(json), terminal_(isatty(STDERR_FILENO) != 0) {}

  void tell(const pull::PullStatus& status) {
    using namespace std::chrono_literals;
    const auto now = std::chrono::steady_clock::now();
    if (now - last_ < (json_ ? 1000ms : terminal_ ? 200ms : 10000ms)) return;
    last_ = now;
    draw(status);
  }
  void end(const pull::PullStatus& status) {
    draw(status);
    if (terminal_ && !json_) std::fputc('\n', stderr);
  }

 private:
  void draw(const pull::PullStatus& status) {
    if (json_) {
      fmt::print("{}\n", asJson(status).dump());
      std::fflush(stdout);
      return;
    }
    const auto line = asLine(status);
    if (terminal_)
      fmt::print(stderr, "\r{}\x1b[K", line);
    else if (line != drawn_)
      fmt::print(stderr, "{}\n", line);
    std::fflush(stderr);
    drawn_ = line;
  }

  const bool json_, terminal_;
  std::chrono::steady_clock::time_point last_;
  std::string drawn_;
};

// The folder's mirrors as missions; the one that is being pulled is the current one.
class MirrorBackend final : public link::LinkBackend {
 public:
  MirrorBackend(std::filesystem::path folder, pull::Puller& puller)
      : folder_(std::move(folder)), puller_(puller) {}

  std::vector<link::Mission> missions() const override {
    const auto status = puller_.status();
    std::vector<link::Mission> out;
    std::error_code problem;
    for (const auto& entry : std::filesystem::directory_iterator(folder_, problem)) {
      if (entry.path().extension() != ".overfly") continue;
      const auto name = entry.path().stem().string();
      const bool current = entry.path() == status.mirror;
      out.push_back({name, name, entry.path(), 0, current && status.connected, current});
    }
    std::ranges::sort(out, {}, &link::Mission::id);
    return out;
  }
  std::string statusJson() const override {
    const auto status = puller_.status();
    return nlohmann::json{{"state", !status.connected ? "disconnected"
                                    : status.complete ? "idle"
                                                      : "pulling"},
                          {"lag_s", status.lag_s},
                          {"problem", status.problem},
                          {"pull", asJson(status)}}
        .dump();
  }
  link::Health health() const override { return {true, {}}; }
  void interest(const geo::TileKey& key) override { puller_.lookAt(key); }

 private:
  const std::filesystem::path folder_;
  pull::Puller& puller_;
};

Result<int> pullMap(const Context& context, const Arguments& arguments) {
  pull::PullOptions options;
  options.url = arguments.url;
  options.target = arguments.target;
  options.ca_file = arguments.ca_file;
  options.connections = arguments.connections;
  options.once = arguments.once;
  options.give_up_s = arguments.give_up_s;
  if (!arguments.token_file.empty()) {
    auto token = readToken(arguments.token_file);
    if (!token) return tl::unexpected(token.error());
    options.token = std::move(*token);
  }
  if (!arguments.layers.empty()) {
    options.layers = 0;
    for (const auto& name : arguments.layers) options.layers |= tiling::only(*tiling::layerNamed(name));
  }
  const bool serves = !arguments.serve.empty();
  if (serves && options.target.extension() == ".mbtiles")
    return fail(ErrorCode::BadSettings,
                "--serve needs a folder: an .mbtiles file holds the colour layer alone");

  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGINT, SIGTERM, SIGUSR1}) sigaddset(&signals, signal);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  pull::Puller puller(options);
  std::unique_ptr<link::LinkServer> server;
  if (serves) {
    const auto loaded = loadSettings(context);
    if (!loaded) return tl::unexpected(loaded.error());
    auto settings = loaded->settings.link;
    if (auto applied = applyAddress(arguments.serve, settings); !applied)
      return tl::unexpected(applied.error());
    server = std::make_unique<link::LinkServer>(link::optionsFrom(settings),
                                                std::make_shared<MirrorBackend>(options.target, puller));
    if (auto started = server->start(); !started) return tl::unexpected(started.error());
    fmt::print(context.json ? stderr : stdout, "{}\n", server->url());
    std::fflush(stdout);
    puller.onCommit([&server] { server->mapChanged(); });
  }

  // A signal ends the pull, SIGUSR1 this thread when the pull has ended by itself.
  std::jthread waiter([&] {
    int signal = 0;
    sigwait(&signals, &signal);
    puller.stop();
  });
  Teller teller(context.json);
  const auto done = puller.run([&](const pull::PullStatus& status) { teller.tell(status); });
  pthread_kill(waiter.native_handle(), SIGUSR1);
  waiter.join();
  server.reset();
  if (!done) return tl::unexpected(done.error());
  teller.end(puller.status());
  return kOk;
}

void build(CLI::App& command, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  command
      .add_option("URL", arguments->url,
                  "the address that overflyd prints; also with /t/TOKEN/ or /m/MISSION/")
      ->required();
  command
      .add_option(
          "TARGET", arguments->target,
          "a folder, for mirrors of the missions with all layers, or a file .mbtiles for the colour of one")
      ->required();
  command.add_option("--layers", arguments->layers, "only these layers (default: all)")
      ->delimiter(',')
      ->check(CLI::IsMember({"color", "elevation", "elevation_max", "quality", "thermal", "near_infrared"}));
  command.add_flag("--once", arguments->once, "end when everything that the drone has is here");
  command
      .add_option("--give-up", arguments->give_up_s,
                  "end when the drone has not answered for so many seconds (default: never)")
      ->check(CLI::NonNegativeNumber);
  command.add_option("--connections", arguments->connections, "connections to the drone at most")
      ->check(CLI::Range(1, 4))
      ->capture_default_str();
  command.add_option("--serve", arguments->serve,
                     "serve the mirror at ADDRESS:PORT meanwhile, with page, tiles and events");
  command.add_option("--token-file", arguments->token_file, "file that holds the drone's token");
  command.add_option("--ca", arguments->ca_file, "certificate (PEM) to trust, for a drone that made its own");
  command.footer(
      "It can be ended and started again at any moment, and goes on where it was. Exit status 1 when "
      "--give-up's time "
      "has passed.");
  context.onRun(command, [arguments, &context] { return pullMap(context, *arguments); });
}

const Registered registered{"pull", "mirrors a drone's map to the ground and keeps it fresh", build};

}  // namespace
}  // namespace overfly::cli
