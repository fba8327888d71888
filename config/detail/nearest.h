#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace overfly::config::detail {

// Number of single insertions, deletions, replacements and swaps of neighbours that turn a into b (the
// optimal string alignment distance).
[[nodiscard]] std::size_t editDistance(std::string_view a, std::string_view b);

// The candidate that a person most likely meant: fewest edits, at most a third of the longer word (at least
// one); none when nothing is that near. The first of equals.
[[nodiscard]] std::optional<std::string> nearest(std::string_view word,
                                                 const std::vector<std::string>& candidates);

// The key ("section.key") that was most likely meant by a key that does not exist: the same stem with
// another unit, a near name in the section, the same name in another section. `section` may be empty.
[[nodiscard]] std::optional<std::string> nearestKey(std::string_view section, std::string_view name);

}  // namespace overfly::config::detail
