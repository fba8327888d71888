#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>

// The few GLSL types and functions that shaders/material.glsl and amplify's shared shader text use, so that
// the ray-tracer and the truth compile the very text that the rasteriser compiles. Values as in GLSL ES 3.1,
// float32 throughout; all functions are reentrant.
namespace overfly::scene::glsl {

using uint = std::uint32_t;

struct vec2 {
  float x = 0, y = 0;
  constexpr vec2() = default;
  constexpr explicit vec2(float s) : x(s), y(s) {}
  constexpr vec2(float px, float py) : x(px), y(py) {}
};
struct vec3 {
  float x = 0, y = 0, z = 0;
  constexpr vec3() = default;
  constexpr explicit vec3(float s) : x(s), y(s), z(s) {}
  constexpr vec3(float px, float py, float pz) : x(px), y(py), z(pz) {}
};

constexpr vec2 operator+(vec2 a, vec2 b) { return {a.x + b.x, a.y + b.y}; }
constexpr vec2 operator-(vec2 a, vec2 b) { return {a.x - b.x, a.y - b.y}; }
constexpr vec2 operator*(vec2 a, float s) { return {a.x * s, a.y * s}; }
constexpr vec2 operator*(float s, vec2 a) { return a * s; }
constexpr vec3 operator+(vec3 a, vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
constexpr vec3 operator-(vec3 a, vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
constexpr vec3 operator*(vec3 a, vec3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
constexpr vec3 operator*(vec3 a, float s) { return {a.x * s, a.y * s, a.z * s}; }
constexpr vec3 operator*(float s, vec3 a) { return a * s; }

inline float floor(float v) { return std::floor(v); }
inline float fract(float v) { return v - std::floor(v); }
inline float abs(float v) { return std::fabs(v); }
inline float sqrt(float v) { return std::sqrt(v); }
inline float sin(float v) { return std::sin(v); }
inline float cos(float v) { return std::cos(v); }
inline float exp(float v) { return std::exp(v); }
constexpr float min(float a, float b) { return b < a ? b : a; }
constexpr float max(float a, float b) { return a < b ? b : a; }
constexpr int min(int a, int b) { return b < a ? b : a; }
constexpr int max(int a, int b) { return a < b ? b : a; }
constexpr float clamp(float v, float lo, float hi) { return min(max(v, lo), hi); }
constexpr int clamp(int v, int lo, int hi) { return min(max(v, lo), hi); }
constexpr float mix(float a, float b, float t) { return a * (1.0f - t) + b * t; }
constexpr vec3 mix(vec3 a, vec3 b, float t) { return a * (1.0f - t) + b * t; }
constexpr float step(float edge, float v) { return v < edge ? 0.0f : 1.0f; }
constexpr float smoothstep(float a, float b, float v) {
  const float t = clamp((v - a) / (b - a), 0.0f, 1.0f);
  return t * t * (3.0f - 2.0f * t);
}
constexpr float dot(vec2 a, vec2 b) { return a.x * b.x + a.y * b.y; }
constexpr float dot(vec3 a, vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline float length(vec2 a) { return std::sqrt(dot(a, a)); }
inline float length(vec3 a) { return std::sqrt(dot(a, a)); }
inline vec3 normalize(vec3 a) { return a * (1.0f / length(a)); }

}  // namespace overfly::scene::glsl
