#pragma once
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "config/settings.h"

// What a setting is, told once. Everything that reads, checks, prints or documents settings works on this
// table.
namespace overfly::config {

enum class Kind { Bool, Int, Double, Text, Path, Choice, TextList, Vector3 };

// A setting's value as the table passes it on: int for Int, text for Text, Path and Choice, three doubles for
// Vector3.
using Value =
    std::variant<bool, std::int64_t, double, std::string, std::vector<double>, std::vector<std::string>>;

struct Key {
  std::string section;
  std::string name;  // ends in its unit where it has one
  Kind kind = Kind::Text;
  double min = 0;  // Int, Double, every element of Vector3: inclusive bounds
  double max = 0;
  std::vector<std::string> choices;  // Choice; Int: when not empty, the only values allowed
  std::string pattern;       // Text: ECMAScript expression that the whole value must match; empty: any
  std::string allowed_text;  // what `pattern` allows, for a person
  std::string help;          // one sentence or two, no full stop at the end
  bool live = false;         // a running daemon takes a change on SIGHUP
  std::function<Value(const Settings&)> get;
  std::function<void(Settings&, const Value&)> set;  // the value must have passed check()

  [[nodiscard]] std::string path() const { return section + "." + name; }
};

struct SectionInfo {
  std::string name;
  std::string help;
  std::vector<Key> keys;
};

// All sections in the order in which the sample prints them. Made once; thread-safe.
[[nodiscard]] std::span<const SectionInfo> description();

// The key of that name, or null.
[[nodiscard]] const Key* findKey(std::string_view section, std::string_view name);
[[nodiscard]] const SectionInfo* findSection(std::string_view section);

// The unit that a key's name ends in, in words ("milliseconds" for max_gap_ms); empty when it has none.
[[nodiscard]] std::string unitInWords(std::string_view name);
// The same as written in the name ("ms").
[[nodiscard]] std::string unitSuffix(std::string_view name);

// What a key takes, for a person: "a number from 0 to 90 (degrees)", "one of: sad, ssd, zncc, census".
[[nodiscard]] std::string allowed(const Key& key);

// A value as TOML text.
[[nodiscard]] std::string tomlText(const Value& value);

// The keys ("section.name") whose values differ.
[[nodiscard]] std::vector<const Key*> differences(const Settings& a, const Settings& b);

}  // namespace overfly::config
