#pragma once
#include <string>

#include "daemon/cli/command_tree.h"

namespace overfly::cli {

// Manual pages as roff for man(7), from the program's own descriptions. Pure functions.
[[nodiscard]] std::string commandPage(const CommandText& overfly);  // overfly(1)
[[nodiscard]] std::string daemonPage(const CommandText& overflyd);  // overflyd(8)
[[nodiscard]] std::string settingsPage();  // overfly.toml(5), from config::description()

// Completion scripts for `overfly` and `overflyd`, for bash and zsh.
[[nodiscard]] std::string bashCompletion(const CommandText& overfly, const CommandText& overflyd);
[[nodiscard]] std::string zshCompletion(const CommandText& overfly, const CommandText& overflyd);

}  // namespace overfly::cli
