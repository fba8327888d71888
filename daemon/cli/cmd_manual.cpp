#include <fmt/format.h>

#include <memory>

#include "daemon/cli/command.h"
#include "daemon/cli/daemon_command_line.h"
#include "daemon/cli/manual.h"

namespace overfly::cli {
namespace {

void build(CLI::App& command, Context& context) {
  auto page = std::make_shared<std::string>();
  command.add_option("PAGE", *page, "a manual page, for `man -l`, or a shell, for its completion script")
      ->required()
      ->check(CLI::IsMember({"overfly", "overflyd", "overfly.toml", "bash", "zsh"}));
  context.onRun(command, [page, &context]() -> Result<int> {
    const CommandText overfly = describe(*context.overfly);
    CLI::App daemon_app;
    DaemonArguments arguments;
    buildDaemonCommandLine(daemon_app, arguments);
    const CommandText overflyd = describe(daemon_app);
    fmt::print("{}", *page == "overfly"    ? commandPage(overfly)
                     : *page == "overflyd" ? daemonPage(overflyd)
                     : *page == "bash"     ? bashCompletion(overfly, overflyd)
                     : *page == "zsh"      ? zshCompletion(overfly, overflyd)
                                           : settingsPage());
    return kOk;
  });
}

const Registered registered{"manual", "prints a manual page, or a shell's completion script", build};

}  // namespace
}  // namespace overfly::cli
