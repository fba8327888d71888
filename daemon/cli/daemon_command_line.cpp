#include "daemon/cli/daemon_command_line.h"

namespace overfly::cli {

void buildDaemonCommandLine(CLI::App& app, DaemonArguments& arguments) {
  app.name("overflyd");
  app.description("Maps while the drone flies: frames with pose in, tiles out.");
  app.set_help_flag("-h,--help", "prints this help");
  app.set_version_flag("--version", std::string("overflyd ") + OVERFLY_VERSION, "prints the version");
  app.add_option("--config", arguments.config_file,
                 "settings file instead of /etc/overfly/overfly.toml and conf.d")
      ->type_name("FILE");
  app.add_option("--set", arguments.overrides,
                 "overrides one setting over all files; may be given several times")
      ->type_name("SECTION.KEY=VALUE")
      ->allow_extra_args(false);
  app.add_flag("--exit-when-done", arguments.exit_when_done,
               "ends when the source has ended and everything is mapped");
  app.add_option("--inject-fault", arguments.fault, "")->group("");
}

}  // namespace overfly::cli
