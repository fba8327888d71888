#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace overfly::gl::detail {

using Macros = std::map<std::string, std::string, std::less<>>;

// Value of an integer expression of GLSL's preprocessor or a constant declaration (+ - * / % ( ) comparison,
// && || !, defined X, literals with or without u); names are looked up in `macros`, recursively. nullopt
// where a name is unknown or the text is something else. With `unknown_is_zero` unknown names count as 0, as
// in #if.
[[nodiscard]] std::optional<std::int64_t> evaluate(std::string_view expression, const Macros& macros,
                                                   bool unknown_is_zero);

// The text without comments and without what #if, #ifdef, #ifndef, #elif and #else leave out. Directives are
// removed except #extension; object-like macros and `const int` constants are added to `macros`.
[[nodiscard]] std::string preprocess(std::string_view text, Macros& macros);

}  // namespace overfly::gl::detail
