#pragma once
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace overfly::cli {

// What `overflyd` takes on its command line; beside the commands of `overfly`, so that its manual page comes
// from the same text as its --help.
struct DaemonArguments {
  std::string config_file;             // empty: the installation's files
  std::vector<std::string> overrides;  // section.key=value
  bool exit_when_done = false;
  std::string fault;  // for tests, and so not in the help: see daemon/overflyd/stage.h
};

// `arguments` must outlive the parsing.
void buildDaemonCommandLine(CLI::App& app, DaemonArguments& arguments);

}  // namespace overfly::cli
