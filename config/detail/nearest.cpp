#include "config/detail/nearest.h"

#include <algorithm>

#include "config/description.h"

namespace overfly::config::detail {
namespace {

constexpr std::size_t kLongestWord = 64;  // longer ones are not compared: nobody mistypes that much

// A key's name without its unit.
std::string_view stem(std::string_view name) {
  const std::string unit = unitSuffix(name);
  if (!unit.empty()) name.remove_suffix(unit.size() + 1);
  return name;
}

}  // namespace

std::size_t editDistance(std::string_view a, std::string_view b) {
  const std::size_t columns = b.size() + 1;
  std::vector<std::size_t> before_last(columns), last(columns), row(columns);
  for (std::size_t j = 0; j < columns; ++j) last[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j < columns; ++j) {
      const std::size_t replaced = last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, replaced});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        row[j] = std::min(row[j], before_last[j - 2] + 1);
      }
    }
    std::swap(before_last, last);
    std::swap(last, row);
  }
  return last[b.size()];
}

std::optional<std::string> nearest(std::string_view word, const std::vector<std::string>& candidates) {
  if (word.size() > kLongestWord) return std::nullopt;
  std::optional<std::string> best;
  std::size_t best_distance = 0;
  for (const std::string& candidate : candidates) {
    const std::size_t distance = editDistance(word, candidate);
    const std::size_t limit = std::max<std::size_t>(1, std::max(word.size(), candidate.size()) / 3);
    if (distance <= limit && (!best || distance < best_distance)) {
      best = candidate;
      best_distance = distance;
    }
  }
  return best;
}

std::optional<std::string> nearestKey(std::string_view section, std::string_view name) {
  if (const SectionInfo* info = findSection(section)) {
    std::vector<std::string> names;
    for (const Key& key : info->keys) {
      if (stem(key.name) == stem(name)) return key.path();  // only the unit differs
      names.push_back(key.name);
    }
    if (const auto near = nearest(name, names)) return std::string(section) + "." + *near;
  }
  for (const SectionInfo& other : description()) {
    for (const Key& key : other.keys) {
      if (key.name == name) return key.path();
    }
  }
  return std::nullopt;
}

}  // namespace overfly::config::detail
