#pragma once
#include <string>
#include <string_view>
#include <tl/expected.hpp>

#include "config/description.h"
#include "config/detail/raw.h"

namespace overfly::config::detail {

// A raw value as the value of this key, or one sentence that says what was found and what is allowed.
[[nodiscard]] tl::expected<Value, std::string> check(const Key& key, const Raw& raw);

// Text of the environment or the command line as a raw value of the kind that the key takes; what cannot be
// read as that stays text, which check() then refuses. Lists: "a,b,c", with or without brackets and quotes.
[[nodiscard]] Raw rawFromText(const Key& key, std::string_view text);

// `text` in another unit of the same quantity: inUnit("0.2 s", "ms") is 200. Nothing when it is no number
// with a unit, or one of another quantity.
[[nodiscard]] std::string inUnit(std::string_view text, std::string_view unit);

}  // namespace overfly::config::detail
