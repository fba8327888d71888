#pragma once
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

// Values as a source of settings gives them, before anybody has compared them with the description.
namespace overfly::config::detail {

struct Raw;
struct Other {
  std::string what;  // "a date", "a table"
};
struct Raw {
  std::variant<bool, std::int64_t, double, std::string, std::vector<Raw>, Other> value;
};

// How a value that was found is told to a person.
[[nodiscard]] std::string foundText(const Raw& raw);

}  // namespace overfly::config::detail
