#pragma once
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace overfly::cli {

// A command line as values: what manual pages and completions are made from. Taken from the same CLI::App
// that parses.
struct OptionText {
  std::vector<std::string> names;    // "--json", "-h"; empty for a positional argument
  std::string positional;            // "MAP"; empty for an option
  std::string value;                 // what follows it, "FILE"; empty for a flag
  std::vector<std::string> choices;  // when only these are allowed
  std::string help, default_text;
  bool required = false, several = false;
};

struct CommandText {
  std::vector<std::string> path;  // "overfly", "flight", "info"
  std::string summary, footer;
  std::vector<OptionText> options;
  std::vector<CommandText> commands;

  [[nodiscard]] std::string title() const;     // "overfly flight info"
  [[nodiscard]] std::string synopsis() const;  // options and arguments behind the title, as --help shows them
};

[[nodiscard]] CommandText describe(const CLI::App& app, std::vector<std::string> above = {});

}  // namespace overfly::cli
