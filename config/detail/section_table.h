#pragma once
#include <algorithm>
#include <initializer_list>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "config/description.h"

// The words in which config/description.cpp tells the settings: one SectionTable per section, one key() per
// field, overloaded on the field's type so that the table cannot disagree with the struct.
namespace overfly::config::detail {

struct Range {
  double min;
  double max;
};

// The values of an enum in declaration order, from 0 without a gap.
template <class Enum>
struct Choices {
  std::vector<std::string> names;
};
template <class Enum>
Choices<Enum> choices(std::initializer_list<std::string> names) {
  return {names};
}

struct TextRule {
  std::string pattern;
  std::string allowed;
};

class KeyHandle {
 public:
  explicit KeyHandle(Key& key) : key_(key) {}
  void live() { key_.live = true; }

 private:
  Key& key_;
};

template <class Section>
class SectionTable {
 public:
  SectionTable(std::string name, Section Settings::*section, std::string help)
      : info_{std::move(name), std::move(help), {}}, section_(section) {}

  KeyHandle key(std::string name, bool Section::*field, std::string help) {
    return KeyHandle(addAs<bool>(std::move(name), Kind::Bool, field, std::move(help)));
  }
  KeyHandle key(std::string name, std::string Section::*field, std::string help) {
    return KeyHandle(addAs<std::string>(std::move(name), Kind::Text, field, std::move(help)));
  }
  KeyHandle key(std::string name, std::string Section::*field, TextRule rule, std::string help) {
    Key& key = addAs<std::string>(std::move(name), Kind::Text, field, std::move(help));
    key.pattern = std::move(rule.pattern);
    key.allowed_text = std::move(rule.allowed);
    return KeyHandle(key);
  }
  KeyHandle key(std::string name, std::vector<std::string> Section::*field, std::string help) {
    return KeyHandle(
        addAs<std::vector<std::string>>(std::move(name), Kind::TextList, field, std::move(help)));
  }
  KeyHandle key(std::string name, int Section::*field, Range range, std::string help) {
    return KeyHandle(bounded(addAs<std::int64_t>(std::move(name), Kind::Int, field, std::move(help)), range));
  }
  // One of a few numbers.
  KeyHandle key(std::string name, int Section::*field, std::initializer_list<int> values, std::string help) {
    const auto [least, most] = std::minmax(values);
    Key& key = bounded(addAs<std::int64_t>(std::move(name), Kind::Int, field, std::move(help)),
                       {static_cast<double>(least), static_cast<double>(most)});
    for (const int value : values) key.choices.push_back(std::to_string(value));
    return KeyHandle(key);
  }
  KeyHandle key(std::string name, double Section::*field, Range range, std::string help) {
    return KeyHandle(bounded(addAs<double>(std::move(name), Kind::Double, field, std::move(help)), range));
  }
  KeyHandle key(std::string name, std::filesystem::path Section::*field, std::string help) {
    return KeyHandle(add(
        std::move(name), Kind::Path, std::move(help),
        [section = section_, field](const Settings& s) -> Value { return (s.*section.*field).string(); },
        [section = section_, field](Settings& s, const Value& v) {
          s.*section.*field = std::get<std::string>(v);
        }));
  }
  KeyHandle key(std::string name, std::array<double, 3> Section::*field, Range range, std::string help) {
    return KeyHandle(bounded(add(
                                 std::move(name), Kind::Vector3, std::move(help),
                                 [section = section_, field](const Settings& s) -> Value {
                                   const auto& v = s.*section.*field;
                                   return std::vector<double>(v.begin(), v.end());
                                 },
                                 [section = section_, field](Settings& s, const Value& v) {
                                   const auto& from = std::get<std::vector<double>>(v);
                                   std::copy_n(from.begin(), 3, (s.*section.*field).begin());
                                 }),
                             range));
  }
  template <class Enum>
  KeyHandle key(std::string name, Enum Section::*field, Choices<Enum> enum_choices, std::string help) {
    Key& key = add(
        std::move(name), Kind::Choice, std::move(help),
        [section = section_, field, names = enum_choices.names](const Settings& s) -> Value {
          return names.at(static_cast<std::size_t>(s.*section.*field));
        },
        [section = section_, field, names = enum_choices.names](Settings& s, const Value& v) {
          const auto found = std::find(names.begin(), names.end(), std::get<std::string>(v));
          s.*section.*field = static_cast<Enum>(found - names.begin());
        });
    key.choices = std::move(enum_choices.names);
    return KeyHandle(key);
  }

  [[nodiscard]] SectionInfo take() { return std::move(info_); }

 private:
  template <class Stored, class Field>
  Key& addAs(std::string name, Kind kind, Field Section::*field, std::string help) {
    return add(
        std::move(name), kind, std::move(help),
        [section = section_, field](const Settings& s) -> Value { return Stored{s.*section.*field}; },
        [section = section_, field](Settings& s, const Value& v) {
          s.*section.*field = static_cast<Field>(std::get<Stored>(v));
        });
  }
  Key& add(std::string name, Kind kind, std::string help, std::function<Value(const Settings&)> get,
           std::function<void(Settings&, const Value&)> set) {
    Key key;
    key.section = info_.name;
    key.name = std::move(name);
    key.kind = kind;
    key.help = std::move(help);
    key.get = std::move(get);
    key.set = std::move(set);
    info_.keys.push_back(std::move(key));
    return info_.keys.back();
  }
  static Key& bounded(Key& key, Range range) {
    key.min = range.min;
    key.max = range.max;
    return key;
  }

  SectionInfo info_;
  Section Settings::*section_;
};

}  // namespace overfly::config::detail
