#include "config/detail/check.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <optional>
#include <regex>

#include "config/detail/nearest.h"

namespace overfly::config::detail {
namespace {

constexpr std::size_t kLongestText = 4096;  // bytes of one text value

struct UnitSize {
  std::string_view name;
  std::string_view quantity;
  double size;
};
constexpr double kFoot = 0.3048;  // metres, international foot
constexpr double kDegreesPerRadian = 57.29577951308232;
constexpr std::array<UnitSize, 22> kUnitSizes{
    {{"ns", "time", 1e-9},   {"us", "time", 1e-6},   {"µs", "time", 1e-6},
     {"ms", "time", 1e-3},   {"s", "time", 1},       {"min", "time", 60},
     {"h", "time", 3600},    {"mm", "length", 1e-3}, {"cm", "length", 1e-2},
     {"m", "length", 1},     {"km", "length", 1000}, {"ft", "length", kFoot},
     {"deg", "angle", 1},    {"°", "angle", 1},      {"rad", "angle", kDegreesPerRadian},
     {"kb", "size", 1},      {"mb", "size", 1024},   {"gb", "size", 1048576},
     {"kbps", "rate", 1},    {"mbps", "rate", 1000}, {"px", "pixels", 1},
     {"fps", "frequency", 1}}};

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

// The number at the front of `text`, and what stands behind it. from_chars takes no leading plus.
struct Leading {
  double number;
  std::string_view rest;
};
std::optional<Leading> leadingNumber(std::string_view text) {
  if (text.starts_with('+')) text.remove_prefix(1);
  double number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc{}) return std::nullopt;
  return Leading{number, text.substr(static_cast<std::size_t>(end - text.data()))};
}

std::string refusal(const Key& key, const Raw& raw) {
  std::string message = fmt::format("found {}, allowed {}", foundText(raw), allowed(key));
  const auto* text = std::get_if<std::string>(&raw.value);
  if (text == nullptr) return message;
  if (key.kind == Kind::Int || key.kind == Kind::Double) {
    if (const std::string number = inUnit(*text, unitSuffix(key.name)); !number.empty()) {
      message += fmt::format("; write the number alone: {} = {}", key.name, number);
    } else if (const auto plain = leadingNumber(trimmed(*text)); plain && plain->rest.empty()) {
      message += "; write it without quotes";
    }
  }
  if (key.kind == Kind::Choice) {
    if (const auto near = nearest(*text, key.choices)) message += fmt::format("; did you mean {}?", *near);
  }
  return message;
}

std::optional<double> numberOf(const Raw& raw) {
  if (const auto* i = std::get_if<std::int64_t>(&raw.value)) return static_cast<double>(*i);
  if (const auto* d = std::get_if<double>(&raw.value)) return *d;
  return std::nullopt;
}

// NaN lies in no range.
bool inRange(const Key& key, double number) { return number >= key.min && number <= key.max; }

std::optional<Value> valueOf(const Key& key, const Raw& raw) {
  switch (key.kind) {
    case Kind::Bool:
      if (const auto* b = std::get_if<bool>(&raw.value)) return *b;
      return std::nullopt;
    case Kind::Int: {
      const auto* i = std::get_if<std::int64_t>(&raw.value);
      if (i == nullptr || !inRange(key, static_cast<double>(*i))) return std::nullopt;
      const bool listed =
          key.choices.empty() || std::count(key.choices.begin(), key.choices.end(), std::to_string(*i)) > 0;
      return listed ? std::optional<Value>(*i) : std::nullopt;
    }
    case Kind::Double: {
      const auto number = numberOf(raw);
      return number && inRange(key, *number) ? std::optional<Value>(*number) : std::nullopt;
    }
    case Kind::Text:
    case Kind::Path:
    case Kind::Choice: {
      const auto* text = std::get_if<std::string>(&raw.value);
      if (text == nullptr || text->size() > kLongestText || text->find('\0') != std::string::npos)
        return std::nullopt;
      if (key.kind == Kind::Choice && std::count(key.choices.begin(), key.choices.end(), *text) == 0)
        return std::nullopt;
      // std::regex recurses per character: no pattern of ours is meant for long texts
      constexpr std::size_t kLongestMatched = 256;
      if (!key.pattern.empty() &&
          (text->size() > kLongestMatched || !std::regex_match(*text, std::regex(key.pattern)))) {
        return std::nullopt;
      }
      return *text;
    }
    case Kind::TextList: {
      const auto* list = std::get_if<std::vector<Raw>>(&raw.value);
      if (list == nullptr) return std::nullopt;
      std::vector<std::string> texts;
      for (const Raw& item : *list) {
        const auto* text = std::get_if<std::string>(&item.value);
        if (text == nullptr || text->size() > kLongestText) return std::nullopt;
        texts.push_back(*text);
      }
      return texts;
    }
    case Kind::Vector3: {
      const auto* list = std::get_if<std::vector<Raw>>(&raw.value);
      if (list == nullptr || list->size() != 3) return std::nullopt;
      std::vector<double> numbers;
      for (const Raw& item : *list) {
        const auto number = numberOf(item);
        if (!number || !inRange(key, *number)) return std::nullopt;
        numbers.push_back(*number);
      }
      return numbers;
    }
  }
  return std::nullopt;
}

Raw scalarFromText(Kind kind, std::string_view text) {
  const std::string_view bare = trimmed(text);
  if (kind == Kind::Bool) {
    if (bare == "true") return {true};
    if (bare == "false") return {false};
  }
  if (kind == Kind::Int) {
    std::int64_t number = 0;
    const std::string_view digits = bare.starts_with('+') ? bare.substr(1) : bare;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
    if (error == std::errc{} && end == digits.data() + digits.size()) return {number};
  }
  if (kind == Kind::Double || kind == Kind::Vector3) {
    if (const auto number = leadingNumber(bare); number && number->rest.empty()) return {number->number};
  }
  return {std::string(text)};
}

}  // namespace

std::string foundText(const Raw& raw) {
  struct Visitor {
    std::string operator()(bool v) const { return tomlText(v); }
    std::string operator()(std::int64_t v) const { return tomlText(v); }
    std::string operator()(double v) const { return tomlText(v); }
    std::string operator()(const std::string& v) const {
      constexpr std::size_t kShown = 60;
      return v.size() <= kShown ? tomlText(v) : fmt::format("a text of {} characters", v.size());
    }
    std::string operator()(const std::vector<Raw>& v) const {
      constexpr std::size_t kShown = 6;
      if (v.size() > kShown) return fmt::format("a list of {}", v.size());
      std::vector<std::string> items;
      std::transform(v.begin(), v.end(), std::back_inserter(items),
                     [](const Raw& item) { return foundText(item); });
      return fmt::format("[{}]", fmt::join(items, ", "));
    }
    std::string operator()(const Other& v) const { return v.what; }
  };
  return std::visit(Visitor{}, raw.value);
}

tl::expected<Value, std::string> check(const Key& key, const Raw& raw) {
  if (auto value = valueOf(key, raw)) return *std::move(value);
  return tl::unexpected(refusal(key, raw));
}

Raw rawFromText(const Key& key, std::string_view text) {
  if (key.kind != Kind::TextList && key.kind != Kind::Vector3) return scalarFromText(key.kind, text);
  std::string_view inside = trimmed(text);
  if (inside.starts_with('[') && inside.ends_with(']')) inside = trimmed(inside.substr(1, inside.size() - 2));
  std::vector<Raw> items;
  while (!inside.empty()) {
    const std::size_t comma = std::min(inside.find(','), inside.size());
    std::string_view item = trimmed(inside.substr(0, comma));
    if (item.size() >= 2 && item.front() == '"' && item.back() == '"') item = item.substr(1, item.size() - 2);
    items.push_back(scalarFromText(key.kind == Kind::TextList ? Kind::Text : key.kind, item));
    inside.remove_prefix(std::min(comma + 1, inside.size()));
  }
  return {std::move(items)};
}

std::string inUnit(std::string_view text, std::string_view unit) {
  const auto leading = leadingNumber(trimmed(text));
  if (!leading) return {};
  std::string found(trimmed(leading->rest));
  std::transform(found.begin(), found.end(), found.begin(),
                 [](unsigned char c) { return static_cast<char>(c < 0x80 ? std::tolower(c) : c); });
  const auto size_of = [](std::string_view name) {
    return std::find_if(kUnitSizes.begin(), kUnitSizes.end(),
                        [&](const UnitSize& u) { return u.name == name; });
  };
  const auto from = size_of(found);
  const auto to = size_of(unit);
  if (from == kUnitSizes.end() || to == kUnitSizes.end() || from->quantity != to->quantity) return {};
  return fmt::format("{:.9g}", leading->number * from->size / to->size);
}

}  // namespace overfly::config::detail
