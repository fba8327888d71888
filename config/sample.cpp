#include "config/sample.h"

#include <fmt/format.h>

#include <string_view>

#include "config/description.h"

namespace overfly::config {
namespace {

constexpr std::size_t kWidth = 100;

// `text` as comment lines of at most kWidth characters, broken at spaces.
std::string comment(std::string_view text) {
  std::string out;
  std::string line = "#";
  std::size_t at = 0;
  while (at < text.size()) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    const std::string_view word = text.substr(at, end - at);
    if (line.size() > 1 && line.size() + 1 + word.size() > kWidth) {
      out += line + "\n";
      line = "#";
    }
    line += ' ';
    line += word;
    at = end + 1;
  }
  return out + line + "\n";
}

}  // namespace

std::string sampleText(const Settings& settings) {
  const Settings defaults;
  std::string out = comment(
      "Settings of overfly. A line with a value that is commented out shows the default. A running daemon "
      "takes a change of a key that is marked \"live\" on SIGHUP; the others count from its next start.");
  for (const SectionInfo& section : description()) {
    out += "\n" + comment(section.help) + "[" + section.name + "]\n";
    for (const Key& key : section.keys) {
      const Value value = key.get(settings);
      const bool is_default = value == key.get(defaults);
      out += "\n" + comment(key.help) + comment("allowed: " + allowed(key) + (key.live ? "; live" : "")) +
             fmt::format("{}{} = {}\n", is_default ? "#" : "", key.name, tomlText(value));
    }
  }
  return out;
}

}  // namespace overfly::config
