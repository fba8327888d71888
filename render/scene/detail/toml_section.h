#pragma once
#include <toml++/toml.h>

#include <Eigen/Core>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "config/error.h"

namespace overfly::scene {

// The first thing that is wrong with a file; later ones are dropped.
class TomlProblems {
 public:
  explicit TomlProblems(std::string file) : file_(std::move(file)) {}
  void add(const toml::node* where, const std::string& key, const std::string& what);
  [[nodiscard]] const std::optional<Error>& first() const { return first_; }

 private:
  std::string file_;
  std::optional<Error> first_;
};

// One table of a file, read key by key. Every reader returns `fallback` where the key is absent, and notes a
// problem naming file, line and key where it is of the wrong kind or out of bounds. finish() notes keys that
// nobody read. Bound to one thread.
class TomlSection {
 public:
  // `table` may be null: an absent section, every key at its default.
  TomlSection(TomlProblems& problems, const toml::table* table, std::string name)
      : problems_(problems), table_(table), name_(std::move(name)) {}

  [[nodiscard]] bool present() const { return table_ != nullptr; }
  [[nodiscard]] bool has(std::string_view key) const { return table_ && table_->contains(key); }
  double number(std::string_view key, double fallback, double least, double most);
  int integer(std::string_view key, int fallback, int least, int most);
  bool flag(std::string_view key, bool fallback);
  std::string text(std::string_view key, std::string fallback);
  double angle(std::string_view key, double fallback_rad, double least_deg,
               double most_deg);  // file: degrees
  // Exactly `count` numbers.
  std::vector<double> numbers(std::string_view key, std::vector<double> fallback, std::size_t count);
  Eigen::Vector2d pair(std::string_view key, const Eigen::Vector2d& fallback);
  // Lists of 2 or 3 numbers.
  std::vector<Eigen::VectorXd> points(std::string_view key, int dimension);
  std::vector<Eigen::Vector2d> polygon(std::string_view key);
  std::vector<std::string> texts(std::string_view key);
  template <typename T>
  T choice(std::string_view key, T fallback, const std::vector<std::pair<std::string_view, T>>& names);
  TomlSection section(std::string_view key);
  std::vector<TomlSection> list(std::string_view key);

  void problem(std::string_view key, const std::string& what);
  void finish();

 private:
  const toml::node* node(std::string_view key);
  [[nodiscard]] std::string path(std::string_view key) const;

  TomlProblems& problems_;
  const toml::table* table_;
  std::string name_;
  std::set<std::string, std::less<>> read_;
};

template <typename T>
T TomlSection::choice(std::string_view key, T fallback,
                      const std::vector<std::pair<std::string_view, T>>& names) {
  if (!node(key)) return fallback;
  const std::string given = text(key, "");
  std::string known;
  for (const auto& [name, value] : names) {
    if (name == given) return value;
    known += (known.empty() ? "" : ", ") + std::string(name);
  }
  problem(key, "is \"" + given + "\"; known are " + known);
  return fallback;
}

}  // namespace overfly::scene
