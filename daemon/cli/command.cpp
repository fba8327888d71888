#include "daemon/cli/command.h"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <iostream>

namespace overfly::cli {
namespace {

std::vector<Command>& registry() {
  static std::vector<Command> all;
  return all;
}

}  // namespace

Registered::Registered(std::string name, std::string summary, void (*build)(CLI::App&, Context&)) {
  registry().push_back({std::move(name), std::move(summary), build});
}

std::vector<Command> commands() {
  std::vector<Command> sorted = registry();
  std::sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
  return sorted;
}

void buildCommandLine(CLI::App& app, Context& context) {
  context.overfly = &app;
  app.name("overfly");
  app.description("Maps while the drone flies: elevation and true orthophoto from camera frames with pose.");
  app.fallthrough();  // the options below may also stand behind the command
  app.require_subcommand(1);
  app.set_version_flag("--version", std::string("overfly ") + OVERFLY_VERSION, "prints the version");
  app.set_help_flag("-h,--help", "prints this help");
  app.add_flag("--json", context.json, "prints results as JSON where the command has any");
  app.add_option("--set", context.overrides, "overrides one setting; may be given several times")
      ->type_name("SECTION.KEY=VALUE")
      ->allow_extra_args(false);
  for (const Command& command : commands()) {
    CLI::App* sub = app.add_subcommand(command.name, command.summary);
    command.build(*sub, context);
    // A group without an action of its own is incomplete without one of its subcommands.
    if (!sub->get_subcommands({}).empty() && sub->get_require_subcommand_min() == 0) {
      sub->require_subcommand(1);
    }
  }
}

Result<config::Loaded> loadSettings(const Context& context,
                                    const std::optional<std::filesystem::path>& file) {
  config::Sources sources = config::installedSources("/etc/overfly", file);
  sources.overrides = context.overrides;
  return config::load(sources).map_error(config::errorFrom);
}

int run(int argc, const char* const* argv) {
  CLI::App app;
  Context context;
  buildCommandLine(app, context);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& asked) {  // --help, --version
    return app.exit(asked);
  } catch (const CLI::ParseError& error) {
    std::cerr << "overfly: " << error.what() << "; try --help\n";
    return kBadUsage;
  }
  try {
    const Result<int> status = context.chosen()();
    std::cout.flush();
    if (!status) {
      const std::string& message = status.error().message;
      const bool several = message.find('\n') != std::string::npos;  // one line each, as compilers do
      std::cerr << (several ? "" : "overfly: ") << message << '\n';
      return status.error().code == ErrorCode::BadSettings ? kBadUsage : kFailed;
    }
    if (!std::cout || std::fflush(stdout) != 0) {
      std::cerr << "overfly: the output could not be written; is the disk full or the pipe closed?\n";
      return kFailed;
    }
    return *status;
  } catch (const std::exception& error) {
    std::cerr << "overfly: internal error: " << error.what() << '\n';
    return kFailed;
  }
}

}  // namespace overfly::cli
