#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "daemon/cli/command.h"
#include "daemon/link/token.h"

namespace overfly::cli {
namespace {

Result<int> makeNew(const Context& context, const std::string& file) {
  std::filesystem::path path(file);
  if (path.empty()) {
    const auto loaded = loadSettings(context);
    if (!loaded) return tl::unexpected(loaded.error());
    path = loaded->settings.link.token_file;
  }
  const auto token = link::makeToken();
  if (auto written = link::writeToken(path, token); !written) return tl::unexpected(written.error());
  fmt::print("{}\n", token);
  fmt::print(stderr, "written to {}; the daemon takes it when it starts again\n", path.string());
  return kOk;
}

void build(CLI::App& command, Context& context) {
  auto file = std::make_shared<std::string>();
  auto* make =
      command.add_subcommand("new", "makes a new token, writes it for the daemon alone, prints it once");
  make->add_option("--file", *file, "instead of the settings' link.token_file");
  context.onRun(*make, [file, &context] { return makeNew(context, *file); });
  command.require_subcommand(1);
}

const Registered registered{"token", "the secret that clients of the link show", build};

}  // namespace
}  // namespace overfly::cli
