#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "config/description.h"
#include "config/load.h"
#include "config/sample.h"
#include "daemon/cli/command.h"

namespace overfly::cli {
namespace {

nlohmann::json jsonFrom(const config::Value& value) {
  return std::visit([](const auto& v) { return nlohmann::json(v); }, value);
}

nlohmann::json jsonFrom(const config::Settings& settings) {
  nlohmann::json out = nlohmann::json::object();
  for (const config::SectionInfo& section : config::description()) {
    for (const config::Key& key : section.keys) out[section.name][key.name] = jsonFrom(key.get(settings));
  }
  return out;
}

nlohmann::json jsonFrom(const config::Problems& problems) {
  nlohmann::json out = nlohmann::json::array();
  for (const config::Problem& problem : problems) {
    out.push_back({{"source", problem.origin.source},
                   {"line", problem.origin.line},
                   {"key", problem.key},
                   {"message", problem.message}});
  }
  return out;
}

Result<int> print(const Context& context, bool defaults, const std::optional<std::filesystem::path>& file) {
  config::Settings settings;
  if (!defaults) {
    const auto loaded = loadSettings(context, file);
    if (!loaded) return tl::unexpected(loaded.error());
    settings = loaded->settings;
  }
  fmt::print("{}", context.json ? jsonFrom(settings).dump(2) + "\n" : config::sampleText(settings));
  return kOk;
}

Result<int> checkFile(const Context& context, const std::filesystem::path& file) {
  config::Sources sources;
  sources.files = {file};
  sources.overrides = context.overrides;
  const auto loaded = config::load(sources);
  if (context.json) {
    fmt::print("{}\n", jsonFrom(loaded ? config::Problems{} : loaded.error()).dump(2));
    return loaded ? kOk : kBadUsage;
  }
  if (!loaded) return tl::unexpected(config::errorFrom(loaded.error()));
  fmt::print("{}: good, {} settings differ from their defaults\n", file.string(),
             config::differences(loaded->settings, {}).size());
  return kOk;
}

void build(CLI::App& command, Context& context) {
  auto defaults = std::make_shared<bool>(false);
  auto file = std::make_shared<std::optional<std::filesystem::path>>();
  CLI::App* print_command =
      command.add_subcommand("print", "prints the settings in force as a commented TOML file");
  print_command->add_flag("--defaults", *defaults, "prints the defaults: the sample file");
  print_command->add_option("--config", *file, "reads this file instead of those in /etc/overfly")
      ->type_name("FILE");
  context.onRun(*print_command, [&context, defaults, file] { return print(context, *defaults, *file); });

  auto checked = std::make_shared<std::filesystem::path>();
  CLI::App* check_command =
      command.add_subcommand("check", "checks a settings file and names everything that is wrong in it");
  check_command->add_option("FILE", *checked, "the file")->required();
  context.onRun(*check_command, [&context, checked] { return checkFile(context, *checked); });
}

const Registered registered{"config", "prints and checks the settings", build};

}  // namespace
}  // namespace overfly::cli
