#pragma once
#include <CLI/CLI.hpp>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "config/error.h"
#include "config/load.h"

// The frame that every command of `overfly` stands in. A new command is one file, cmd_<name>.cpp:
//
//   namespace {
//   void build(CLI::App& command, Context& context) {
//     auto folder = std::make_shared<std::string>();
//     CLI::App* info = command.add_subcommand("info", "prints what a flight holds");
//     info->add_option("DIR", *folder, "folder of the flight")->required();
//     context.onRun(*info, [folder, &context]() -> Result<int> { ...; return kOk; });
//   }
//   const Registered registered{"flight", "recorded flights", build};
//   }  // namespace
//
// with the libraries that it needs in cmd_<name>.deps, one a line. Nothing else is edited.
namespace overfly::cli {

// Exit statuses. A command may return another only where its help says so.
inline constexpr int kOk = 0;
inline constexpr int kFailed = 1;    // the work could not be done
inline constexpr int kBadUsage = 2;  // arguments or settings that the user must change

// What the arguments before and between the commands say. Lives as long as the program; commands keep a
// reference. Single thread.
class Context {
 public:
  bool json = false;                   // --json: results on stdout as JSON, for programs
  std::vector<std::string> overrides;  // --set section.key=value, in the order given
  CLI::App* overfly = nullptr;         // the whole command line, for what documents it

  using Action = std::function<Result<int>()>;

  // What runs when the user names this (sub)command. The action returns an exit status, or an error, which
  // is printed to stderr as "overfly: <message>" and ends with kBadUsage for ErrorCode::BadSettings and
  // kFailed for all others.
  void onRun(CLI::App& command, Action action) {
    command.callback([this, action = std::move(action)] { chosen_ = action; });
  }
  [[nodiscard]] const Action& chosen() const { return chosen_; }

 private:
  Action chosen_;
};

// A command of the program; `build` adds options and subcommands to the App made for it.
struct Command {
  std::string name;
  std::string summary;  // one line, for the list that --help prints
  void (*build)(CLI::App& command, Context& context);
};

// The settings in force: the installation's files (or only `file`), the environment, --set. BadSettings names
// everything that is wrong, one line each.
[[nodiscard]] Result<config::Loaded> loadSettings(
    const Context& context, const std::optional<std::filesystem::path>& file = std::nullopt);

// Puts a command on the program's list when a static object of it is made.
struct Registered {
  Registered(std::string name, std::string summary, void (*build)(CLI::App& command, Context& context));
};

// All registered commands, by name.
[[nodiscard]] std::vector<Command> commands();

// Builds the command line into `app` and `context` without parsing anything.
void buildCommandLine(CLI::App& app, Context& context);

// The whole program: parses, runs, prints an error if there is one, and returns the exit status.
[[nodiscard]] int run(int argc, const char* const* argv);

}  // namespace overfly::cli
