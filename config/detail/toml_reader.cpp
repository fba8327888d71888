#include "config/detail/toml_reader.h"

#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

#include <algorithm>

namespace overfly::config::detail {
namespace {

constexpr int kMostFaults = 20;  // one unclosed bracket can make nonsense of all that follows

// Name of the section that stands in for a header that cannot be read; its keys are not reported on.
constexpr std::string_view kUnreadable = "?";

int lineOf(const toml::node& node) { return static_cast<int>(node.source().begin.line); }

Raw rawOf(const toml::node& node) {
  if (const auto* v = node.as_boolean()) return {v->get()};
  if (const auto* v = node.as_integer()) return {v->get()};
  if (const auto* v = node.as_floating_point()) return {v->get()};
  if (const auto* v = node.as_string()) return {v->get()};
  if (const auto* v = node.as_array()) {
    std::vector<Raw> items;
    for (const toml::node& item : *v) items.push_back(rawOf(item));
    return {std::move(items)};
  }
  if (node.is_table()) return {Other{"a table"}};
  return {Other{node.is_date() ? "a date" : node.is_time() ? "a time" : "a date and time"}};
}

void collect(const toml::table& root, TomlText& out) {
  for (const auto& [name, node] : root) {
    const std::string section(name.str());
    if (section == kUnreadable) continue;
    const toml::table* table = node.as_table();
    if (table == nullptr) {
      const bool is_section_list = node.is_array_of_tables();
      out.entries.push_back({is_section_list ? section : "", is_section_list ? "" : section, rawOf(node),
                             static_cast<int>(name.source().begin.line)});
      continue;
    }
    out.sections.push_back({section, static_cast<int>(name.source().begin.line)});
    for (const auto& [key, value] : *table) {
      out.entries.push_back({section, std::string(key.str()), rawOf(value), lineOf(value)});
    }
  }
  const auto by_line = [](const auto& a, const auto& b) { return a.line < b.line; };
  std::stable_sort(out.sections.begin(), out.sections.end(), by_line);
  std::stable_sort(out.entries.begin(), out.entries.end(), by_line);
}

// Offset and length of a line (from 1) without its line end; nothing behind the last one.
std::pair<std::size_t, std::size_t> lineSpan(const std::string& text, int line) {
  std::size_t begin = 0;
  for (int i = 1; i < line && begin < text.size(); ++i) {
    begin = std::min(text.find('\n', begin), text.size() - 1) + 1;
  }
  return {begin, std::min(text.find('\n', begin), text.size()) - std::min(begin, text.size())};
}

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

// A line that the parser cannot read, as far as its look tells what it was meant for.
TomlFault faultAt(const std::string& text, int line, std::string_view message) {
  TomlFault fault;
  fault.line = line;
  fault.message = message;
  const auto [begin, length] = lineSpan(text, line);
  const std::string_view content =
      trimmed(std::string_view(text).substr(std::min(begin, text.size()), length));
  const auto equals = content.find('=');
  if (equals == std::string_view::npos || content.starts_with('[')) {
    fault.found = content;
    return fault;
  }
  fault.key = trimmed(content.substr(0, equals));
  fault.found = trimmed(content.substr(equals + 1));
  for (int above = line - 1; above > 0 && fault.section.empty(); --above) {
    const auto [at, size] = lineSpan(text, above);
    const std::string_view header = trimmed(std::string_view(text).substr(at, size));
    if (header.starts_with('[') && header.ends_with(']'))
      fault.section = trimmed(header.substr(1, header.size() - 2));
  }
  return fault;
}

// Puts something readable in the place of a line, and says whether that changed anything.
bool blankLine(std::string& text, int line, int fault) {
  const auto [begin, length] = lineSpan(text, line);
  const std::string old = text.substr(std::min(begin, text.size()), length);
  const auto first = old.find_first_not_of(" \t");
  const bool header = first != std::string::npos && old[first] == '[';
  const std::string patch =
      header ? "[\"" + std::string(kUnreadable) + "\"." + std::to_string(fault) + "]" : "";
  if (old == patch || old.find_first_not_of(" \t\r") == std::string::npos) return false;
  text.replace(begin, length, patch);
  return true;
}

// The first line that begins like a section's header and goes on with what can begin no name, such as "[=":
// toml++ 3.3 asserts (and under clang assumes) that there is none, so it must not see one. 0: there is none.
// The lists of lists that look alike ("[{", "[+1") are no setting's value.
int lineOfBadHeader(std::string_view text) {
  int line = 1;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view content = trimmed(text.substr(0, end));
    if (content.starts_with('[')) {
      content.remove_prefix(content.starts_with("[[") ? 2 : 1);
      content = trimmed(content);
      const auto c = content.empty() ? '\0' : content.front();
      const bool letter_or_digit = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
      if (!letter_or_digit && std::string_view("-_\"'[]").find(c) == std::string_view::npos) return line;
    }
    text.remove_prefix(std::min(end + 1, text.size()));
    ++line;
  }
  return 0;
}

}  // namespace

TomlText readToml(std::string_view text) {
  TomlText out;
  std::string readable(text);
  for (int fault = 1; fault <= kMostFaults; ++fault) {
    if (const int line = lineOfBadHeader(readable); line > 0) {
      out.faults.push_back(
          faultAt(readable, line, "a section's name begins with a letter, a digit, '-' or '_'"));
      if (!blankLine(readable, line, fault)) break;
      continue;
    }
    const toml::parse_result parsed = toml::parse(std::string_view(readable));
    if (parsed) {
      collect(parsed.table(), out);
      return out;
    }
    const toml::parse_error& error = parsed.error();
    const int line = static_cast<int>(error.source().begin.line);
    out.faults.push_back(faultAt(readable, line, error.description()));
    if (!blankLine(readable, line, fault)) break;
  }
  return out;
}

}  // namespace overfly::config::detail
