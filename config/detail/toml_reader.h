#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "config/detail/raw.h"

namespace overfly::config::detail {

struct TomlEntry {
  std::string section;  // empty: stands outside any section
  std::string key;      // empty: `section` itself is no table, `value` is what it is instead
  Raw value;
  int line = 0;
};
struct TomlFault {
  int line = 0;
  std::string section;  // the last header above; empty: none
  std::string key;      // what stands before the line's '='; empty: none
  std::string found;    // the line, or what stands behind its '='
  std::string message;  // the parser's
};
struct TomlSection {
  std::string name;
  int line = 0;
};

// What a TOML text holds, in the order of its lines, and every syntax error in it: a line that cannot be read
// is reported and left out, and what stands below it is read all the same.
struct TomlText {
  std::vector<TomlSection> sections;
  std::vector<TomlEntry> entries;
  std::vector<TomlFault> faults;
};
[[nodiscard]] TomlText readToml(std::string_view text);

}  // namespace overfly::config::detail
