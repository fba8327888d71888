#pragma once
#include <cmath>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

// Reading values out of JSON that somebody else wrote: nothing throws, whatever the type found.
namespace overfly::capture {

using Json = nlohmann::json;

// Null when the text is not JSON.
[[nodiscard]] inline std::optional<Json> parseJson(const std::string& text) {
  Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded()) return std::nullopt;
  return json;
}

[[nodiscard]] inline const Json* member(const Json& object, const char* key) {
  if (!object.is_object()) return nullptr;
  const auto found = object.find(key);
  return found == object.end() ? nullptr : &*found;
}

// nullopt: absent, not a number, or not finite.
[[nodiscard]] inline std::optional<double> numberIn(const Json& object, const char* key) {
  const Json* value = member(object, key);
  if (!value || !value->is_number()) return std::nullopt;
  const double number = value->get<double>();
  if (!std::isfinite(number)) return std::nullopt;
  return number;
}

// nullopt: absent, not a whole number, or beyond int64.
[[nodiscard]] inline std::optional<std::int64_t> integerIn(const Json& object, const char* key) {
  const Json* value = member(object, key);
  if (!value || !value->is_number_integer()) return std::nullopt;
  if (value->is_number_unsigned() &&
      value->get<std::uint64_t>() > static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max())) {
    return std::nullopt;
  }
  return value->get<std::int64_t>();
}

[[nodiscard]] inline std::optional<std::string> textIn(const Json& object, const char* key) {
  const Json* value = member(object, key);
  if (!value || !value->is_string()) return std::nullopt;
  return value->get<std::string>();
}

// nullopt: absent, not an array, or something in it is not a finite number.
[[nodiscard]] inline std::optional<std::vector<double>> numbersIn(const Json& object, const char* key) {
  const Json* value = member(object, key);
  if (!value || !value->is_array() || value->size() > 4096) return std::nullopt;
  std::vector<double> numbers;
  for (const Json& item : *value) {
    if (!item.is_number() || !std::isfinite(item.get<double>())) return std::nullopt;
    numbers.push_back(item.get<double>());
  }
  return numbers;
}

}  // namespace overfly::capture
