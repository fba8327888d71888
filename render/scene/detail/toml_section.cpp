#include "render/scene/detail/toml_section.h"

#include <fmt/format.h>

namespace overfly::scene {

void TomlProblems::add(const toml::node* where, const std::string& key, const std::string& what) {
  if (first_) return;
  const auto line = where ? where->source().begin.line : 0;
  first_ = Error{ErrorCode::BadSettings, line > 0 ? fmt::format("{}:{}: {} {}", file_, line, key, what)
                                                  : fmt::format("{}: {} {}", file_, key, what)};
}

const toml::node* TomlSection::node(std::string_view key) {
  if (!table_) return nullptr;
  read_.emplace(key);
  return table_->get(key);
}

std::string TomlSection::path(std::string_view key) const {
  return name_.empty() ? std::string(key) : name_ + "." + std::string(key);
}

void TomlSection::problem(std::string_view key, const std::string& what) {
  const toml::node* where = table_ ? table_->get(key) : nullptr;
  problems_.add(where ? where : table_, path(key), what);
}

double TomlSection::number(std::string_view key, double fallback, double least, double most) {
  const toml::node* found = node(key);
  if (!found) return fallback;
  const std::optional<double> value = found->value<double>();
  if (!value) {
    problem(key, "must be a number");
  } else if (!(*value >= least && *value <= most)) {
    problem(key, fmt::format("is {}; it must lie between {} and {}", *value, least, most));
  } else {
    return *value;
  }
  return fallback;
}

int TomlSection::integer(std::string_view key, int fallback, int least, int most) {
  const toml::node* found = node(key);
  if (!found) return fallback;
  const auto* value = found->as_integer();
  if (!value) {
    problem(key, "must be a whole number");
  } else if (value->get() < least || value->get() > most) {
    problem(key, fmt::format("is {}; it must lie between {} and {}", value->get(), least, most));
  } else {
    return static_cast<int>(value->get());
  }
  return fallback;
}

bool TomlSection::flag(std::string_view key, bool fallback) {
  const toml::node* found = node(key);
  if (!found) return fallback;
  const auto* value = found->as_boolean();
  if (!value) {
    problem(key, "must be true or false");
    return fallback;
  }
  return value->get();
}

std::string TomlSection::text(std::string_view key, std::string fallback) {
  const toml::node* found = node(key);
  if (!found) return fallback;
  const auto* value = found->as_string();
  if (!value) {
    problem(key, "must be a text");
    return fallback;
  }
  return value->get();
}

double TomlSection::angle(std::string_view key, double fallback_rad, double least_deg, double most_deg) {
  constexpr double kDegree = 3.14159265358979323846 / 180.0;
  return number(key, fallback_rad / kDegree, least_deg, most_deg) * kDegree;
}

std::vector<double> TomlSection::numbers(std::string_view key, std::vector<double> fallback,
                                         std::size_t count) {
  const toml::node* found = node(key);
  if (!found) return fallback;
  std::vector<double> values;
  if (const toml::array* array = found->as_array()) {
    for (const toml::node& element : *array) {
      if (const std::optional<double> value = element.value<double>()) values.push_back(*value);
    }
    if (values.size() == count && array->size() == count) return values;
  }
  problem(key, fmt::format("must be a list of {} numbers", count));
  return fallback;
}

Eigen::Vector2d TomlSection::pair(std::string_view key, const Eigen::Vector2d& fallback) {
  const std::vector<double> values = numbers(key, {fallback.x(), fallback.y()}, 2);
  return {values[0], values[1]};
}

std::vector<Eigen::VectorXd> TomlSection::points(std::string_view key, int dimension) {
  std::vector<Eigen::VectorXd> result;
  const toml::node* found = node(key);
  if (!found) return result;
  const toml::array* array = found->as_array();
  bool good = array != nullptr;
  for (std::size_t i = 0; good && i < array->size(); ++i) {
    const toml::array* element = array->get(i)->as_array();
    good = element && element->size() == static_cast<std::size_t>(dimension);
    Eigen::VectorXd point(dimension);
    for (int k = 0; good && k < dimension; ++k) {
      const std::optional<double> value = element->get(static_cast<std::size_t>(k))->value<double>();
      good = value.has_value();
      if (good) point[k] = *value;
    }
    result.push_back(point);
  }
  if (!good) problem(key, fmt::format("must be a list of points of {} numbers", dimension));
  return good ? result : std::vector<Eigen::VectorXd>{};
}

std::vector<Eigen::Vector2d> TomlSection::polygon(std::string_view key) {
  std::vector<Eigen::Vector2d> result;
  for (const Eigen::VectorXd& point : points(key, 2)) result.emplace_back(point[0], point[1]);
  if (!result.empty() && result.size() < 3) problem(key, "must have at least three corners");
  return result;
}

std::vector<std::string> TomlSection::texts(std::string_view key) {
  std::vector<std::string> result;
  const toml::node* found = node(key);
  if (!found) return result;
  const toml::array* array = found->as_array();
  for (std::size_t i = 0; array && i < array->size(); ++i) {
    if (const auto* value = array->get(i)->as_string()) result.push_back(value->get());
  }
  if (!array || result.size() != array->size()) problem(key, "must be a list of texts");
  return result;
}

TomlSection TomlSection::section(std::string_view key) {
  const toml::node* found = node(key);
  if (found && !found->is_table()) problem(key, "must be a section");
  return {problems_, found ? found->as_table() : nullptr, path(key)};
}

std::vector<TomlSection> TomlSection::list(std::string_view key) {
  std::vector<TomlSection> result;
  const toml::node* found = node(key);
  if (!found) return result;
  const toml::array* array = found->as_array();
  if (!array || !array->is_array_of_tables()) {
    problem(key, fmt::format("must be written [[{}]]", path(key)));
    return result;
  }
  for (const toml::node& element : *array) result.emplace_back(problems_, element.as_table(), path(key));
  return result;
}

void TomlSection::finish() {
  if (!table_) return;
  for (const auto& [key, value] : *table_) {
    if (!read_.contains(std::string_view(key.str())))
      problems_.add(&value, path(key.str()), "is not a known key");
  }
}

}  // namespace overfly::scene
