#include <fmt/format.h>

#include <csignal>
#include <filesystem>
#include <memory>

#include "daemon/cli/command.h"
#include "daemon/cli/listen_address.h"
#include "daemon/link/link_server.h"

namespace overfly::cli {
namespace {

Result<int> serve(const Context& context, const std::vector<std::string>& maps, const std::string& address) {
  const auto loaded = loadSettings(context);
  if (!loaded) return tl::unexpected(loaded.error());
  auto settings = loaded->settings.link;
  if (auto applied = applyAddress(address, settings); !applied) return tl::unexpected(applied.error());

  std::vector<link::Mission> missions;
  for (const auto& map : maps) {
    const std::filesystem::path path(map);
    const auto reader = tiling::MapReader::open(path);
    if (!reader) return tl::unexpected(reader.error());
    const auto meta = reader->meta();
    if (!meta) return tl::unexpected(meta.error());
    missions.push_back({path.stem().string(), meta->name.empty() ? path.stem().string() : meta->name, path,
                        meta->created_utc_ns, false, false});
  }
  // the signals wait for sigwait below, also those of the threads that the server starts
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  link::LinkServer server(link::optionsFrom(settings), link::showMaps(std::move(missions)));
  if (auto started = server.start(); !started) return tl::unexpected(started.error());
  fmt::print("{}\n", server.url());
  std::fflush(stdout);
  int signal = 0;
  sigwait(&signals, &signal);
  return kOk;
}

void build(CLI::App& command, Context& context) {
  auto maps = std::make_shared<std::vector<std::string>>();
  auto address = std::make_shared<std::string>();
  command.add_option("MAP", *maps, "map files; the page shows the first one and switches between them")
      ->required();
  command.add_option("--listen", *address, "ADDRESS:PORT instead of the settings' link.listen and link.port");
  context.onRun(command, [maps, address, &context] { return serve(context, *maps, *address); });
}

const Registered registered{"serve", "serves finished maps, read-only: page and tiles", build};

}  // namespace
}  // namespace overfly::cli
