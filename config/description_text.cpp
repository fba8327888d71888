#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "config/description.h"

// The table's lookups and its words.
namespace overfly::config {
namespace {

struct Unit {
  std::string_view suffix;
  std::string_view words;
};
constexpr std::array<Unit, 14> kUnits{{{"us", "microseconds"},
                                       {"ms", "milliseconds"},
                                       {"s", "seconds"},
                                       {"m", "metres"},
                                       {"deg", "degrees"},
                                       {"px", "pixels"},
                                       {"fps", "per second"},
                                       {"kb", "KiB"},
                                       {"mb", "MiB"},
                                       {"kbps", "kilobits per second"},
                                       {"dpt", "dioptres"},
                                       {"heights", "heights above ground"},
                                       {"frames", "frames"},
                                       {"per_s", "per second"}}};

constexpr double kNoUpperBound = 1e9;  // ranges up to here are told without their end

std::string numberText(double value) {
  if (std::isfinite(value) && value == std::floor(value) && std::abs(value) < 1e15) {
    return fmt::format("{:.0f}", value);
  }
  return fmt::format("{}", value);
}

std::string rangeText(const Key& key) {
  if (key.max >= kNoUpperBound) return fmt::format("{} or more", numberText(key.min));
  return fmt::format("from {} to {}", numberText(key.min), numberText(key.max));
}

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (byte < 0x20 || byte == 0x7f) {
      out += fmt::format("\\u{:04X}", byte);
    } else {
      out += c;
    }
  }
  return out + '"';
}

std::string doubleText(double value) {
  if (std::isnan(value)) return "nan";
  if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
  std::string text = fmt::format("{}", value);
  if (text.find_first_of(".e") == std::string::npos) text += ".0";  // TOML tells integers and floats apart
  return text;
}

}  // namespace

const SectionInfo* findSection(std::string_view section) {
  const auto all = description();
  const auto found = std::find_if(all.begin(), all.end(), [&](const auto& s) { return s.name == section; });
  return found == all.end() ? nullptr : &*found;
}

const Key* findKey(std::string_view section, std::string_view name) {
  const SectionInfo* info = findSection(section);
  if (info == nullptr) return nullptr;
  const auto found =
      std::find_if(info->keys.begin(), info->keys.end(), [&](const Key& k) { return k.name == name; });
  return found == info->keys.end() ? nullptr : &*found;
}

std::string unitSuffix(std::string_view name) {
  std::string_view longest;
  for (const Unit& unit : kUnits) {
    if (name.size() > unit.suffix.size() + 1 && name.ends_with(unit.suffix) &&
        name[name.size() - unit.suffix.size() - 1] == '_' && unit.suffix.size() > longest.size()) {
      longest = unit.suffix;
    }
  }
  return std::string(longest);
}

std::string unitInWords(std::string_view name) {
  const std::string suffix = unitSuffix(name);
  const auto found =
      std::find_if(kUnits.begin(), kUnits.end(), [&](const Unit& u) { return u.suffix == suffix; });
  return found == kUnits.end() ? std::string() : std::string(found->words);
}

std::string allowed(const Key& key) {
  const bool is_number = key.kind == Kind::Int || key.kind == Kind::Double || key.kind == Kind::Vector3;
  std::string unit = is_number ? unitInWords(key.name) : std::string();
  if (!unit.empty()) unit = " (" + unit + ")";
  switch (key.kind) {
    case Kind::Bool:
      return "true or false";
    case Kind::Int:
      if (!key.choices.empty()) return fmt::format("one of: {}{}", fmt::join(key.choices, ", "), unit);
      return fmt::format("a whole number {}{}", rangeText(key), unit);
    case Kind::Double:
      return fmt::format("a number {}{}", rangeText(key), unit);
    case Kind::Text:
      return key.allowed_text.empty() ? "text in quotes" : key.allowed_text;
    case Kind::Path:
      return "a path in quotes";
    case Kind::Choice:
      return fmt::format("one of: {}", fmt::join(key.choices, ", "));
    case Kind::TextList:
      return "a list of texts, [\"…\", \"…\"]";
    case Kind::Vector3:
      return fmt::format("a list of three numbers {}{}", rangeText(key), unit);
  }
  return {};
}

std::string tomlText(const Value& value) {
  struct Visitor {
    std::string operator()(bool v) const { return v ? "true" : "false"; }
    std::string operator()(std::int64_t v) const { return std::to_string(v); }
    std::string operator()(double v) const { return doubleText(v); }
    std::string operator()(const std::string& v) const { return quoted(v); }
    std::string operator()(const std::vector<double>& v) const {
      std::vector<std::string> texts;
      std::transform(v.begin(), v.end(), std::back_inserter(texts), doubleText);
      return fmt::format("[{}]", fmt::join(texts, ", "));
    }
    std::string operator()(const std::vector<std::string>& v) const {
      std::vector<std::string> texts;
      std::transform(v.begin(), v.end(), std::back_inserter(texts), quoted);
      return fmt::format("[{}]", fmt::join(texts, ", "));
    }
  };
  return std::visit(Visitor{}, value);
}

std::vector<const Key*> differences(const Settings& a, const Settings& b) {
  std::vector<const Key*> keys;
  for (const SectionInfo& section : description()) {
    for (const Key& key : section.keys) {
      if (key.get(a) != key.get(b)) keys.push_back(&key);
    }
  }
  return keys;
}

}  // namespace overfly::config
