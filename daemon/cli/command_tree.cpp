#include "daemon/cli/command_tree.h"

namespace overfly::cli {
namespace {

// CLI11 appends what a validator allows to the type: "TEXT:{a,b,c}", "FLOAT:NONNEGATIVE".
void splitType(const std::string& type, OptionText& out) {
  const auto colon = type.find(':');
  out.value = type.substr(0, colon);
  const auto open = type.find('{'), close = type.rfind('}');
  if (open == std::string::npos || close == std::string::npos || close < open) return;
  std::string one;
  for (const char c : type.substr(open + 1, close - open - 1) + ",") {
    if (c != ',') {
      one += c;
    } else {
      out.choices.push_back(one);
      one.clear();
    }
  }
}

OptionText describe(const CLI::Option& option) {
  OptionText out;
  if (option.get_positional()) out.positional = option.get_name(true);
  for (const auto& name : option.get_snames()) out.names.push_back("-" + name);
  for (const auto& name : option.get_lnames()) out.names.push_back("--" + name);
  if (option.get_positional() && !out.names.empty()) out.positional.clear();
  if (option.get_items_expected_max() > 0 || !out.positional.empty()) splitType(option.get_type_name(), out);
  out.help = option.get_description();
  out.default_text = option.get_default_str();
  out.required = option.get_required();
  out.several = option.get_items_expected_max() > 1;
  return out;
}

}  // namespace

std::string CommandText::title() const {
  std::string out;
  for (const auto& word : path) out += (out.empty() ? "" : " ") + word;
  return out;
}

std::string CommandText::synopsis() const {
  std::string out;
  bool options_told = false;
  for (const auto& option : options) {
    if (option.positional.empty()) {
      if (!options_told) out += " [OPTIONS]";
      options_told = true;
    }
  }
  for (const auto& option : options) {
    if (option.positional.empty()) continue;
    const auto name = option.positional + (option.several ? "..." : "");
    out += option.required ? " " + name : " [" + name + "]";
  }
  if (!commands.empty()) out += " COMMAND";
  return out;
}

CommandText describe(const CLI::App& app, std::vector<std::string> above) {
  CommandText out;
  out.path = std::move(above);
  out.path.push_back(app.get_name());
  out.summary = app.get_description();
  out.footer = app.get_footer();
  for (const CLI::Option* option : app.get_options()) out.options.push_back(describe(*option));
  for (const CLI::App* command :
       app.get_subcommands([](const CLI::App* one) { return !one->get_name().empty(); }))
    out.commands.push_back(describe(*command, out.path));
  return out;
}

}  // namespace overfly::cli
