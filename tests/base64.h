#pragma once
#include <string>
#include <string_view>

// RFC 4648, for what tests exchange with other programs as text.
namespace overfly::test {

inline constexpr std::string_view kBase64 =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

inline std::string toBase64(const std::string& bytes) {
  std::string out;
  unsigned value = 0;
  int bits = 0;
  for (const char c : bytes) {
    value = value << 8 | static_cast<unsigned char>(c);
    for (bits += 8; bits >= 6; bits -= 6) out += kBase64[value >> (bits - 6) & 63];
  }
  if (bits > 0) out += kBase64[value << (6 - bits) & 63];
  while (out.size() % 4 != 0) out += '=';
  return out;
}

// Passes over what is not of the alphabet.
inline std::string fromBase64(const std::string& text) {
  std::string out;
  unsigned value = 0;
  int bits = 0;
  for (const char c : text) {
    const std::size_t digit = kBase64.find(c);
    if (digit == std::string_view::npos) continue;
    value = value << 6 | static_cast<unsigned>(digit);
    bits += 6;
    if (bits < 8) continue;
    bits -= 8;
    out += static_cast<char>(value >> bits & 255);
  }
  return out;
}

}  // namespace overfly::test
