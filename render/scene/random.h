#pragma once
#include <cmath>
#include <cstdint>
#include <string_view>

namespace overfly::scene {

// Counter-based randomness: a value depends on its seed and its place in the stream alone, never on what was
// drawn before. All functions are reentrant.

[[nodiscard]] constexpr std::uint32_t mixed(std::uint32_t h) {
  h ^= h >> 16;
  h *= 0x7feb352du;
  h ^= h >> 15;
  h *= 0x846ca68bu;
  h ^= h >> 16;
  return h;
}

[[nodiscard]] constexpr std::uint32_t hashOf(std::uint32_t seed, std::uint32_t a, std::uint32_t b = 0) {
  return mixed(mixed(mixed(seed ^ 0x9e3779b9u) + a * 0x85ebca6bu) + b * 0xc2b2ae35u);
}

// FNV-1a of the name, mixed with the parent's seed.
[[nodiscard]] constexpr std::uint32_t seedOf(std::uint32_t parent, std::string_view name) {
  std::uint32_t h = 0x811c9dc5u;
  for (const char c : name) h = (h ^ static_cast<std::uint8_t>(c)) * 0x01000193u;
  return hashOf(h, parent);
}

// Uniform in [0, 1).
[[nodiscard]] constexpr double uniform(std::uint32_t seed, std::uint32_t a, std::uint32_t b = 0) {
  return hashOf(seed, a, b) * 0x1p-32;
}

// Standard normal (Box-Muller).
[[nodiscard]] inline double normal(std::uint32_t seed, std::uint32_t a, std::uint32_t b = 0) {
  const double u = 1.0 - uniform(seed, a, 2 * b);
  const double v = uniform(seed, a, 2 * b + 1);
  return std::sqrt(-2.0 * std::log(u)) * std::cos(6.283185307179586 * v);
}

// A smooth random function of time: unit variance on average, twice differentiable, features of about
// `period` seconds; seven incommensurate sinusoids with random phases.
[[nodiscard]] inline double smoothNoise(std::uint32_t seed, double time_s, double period_s) {
  double sum = 0;
  for (std::uint32_t i = 0; i < 7; ++i) {
    const double rate = (0.4 + 1.2 * (i + uniform(seed, i, 1)) / 7.0) / period_s;
    sum += std::sin(6.283185307179586 * (rate * time_s + uniform(seed, i, 2)));
  }
  return sum * std::sqrt(2.0 / 7.0);
}

}  // namespace overfly::scene
