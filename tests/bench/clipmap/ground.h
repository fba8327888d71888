#pragma once
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace overfly::tiling {

// Ground as a camera sees it: noise of every scale between two pixels and 256, coloured. Rows of RGB without
// gaps; different for each seed, the same on every machine.
inline std::vector<std::uint8_t> paintGround(int width, int height, std::uint32_t seed) {
  const auto hash = [seed](std::uint32_t x, std::uint32_t y, std::uint32_t octave) {
    std::uint32_t h = (x * 0x9E3779B1U) ^ (y * 0x85EBCA77U) ^ (octave * 0xC2B2AE3DU) ^ (seed * 0x27D4EB2FU);
    h = (h ^ (h >> 15)) * 0x2C1B3C6DU;
    h = (h ^ (h >> 12)) * 0x297A2D39U;
    return static_cast<float>((h ^ (h >> 15)) & 0xffffU) / 65535.0f - 0.5f;
  };
  const auto w = static_cast<std::size_t>(width), h = static_cast<std::size_t>(height);
  std::vector<float> luma(w * h, 110.0f);
  for (std::uint32_t octave = 1; octave <= 8; ++octave) {
    const int cell = 1 << octave;
    const float amplitude = 7.0f * std::pow(static_cast<float>(cell), 0.45f);
    for (int y = 0; y < height; ++y) {
      const auto cy = static_cast<std::uint32_t>(y / cell);
      const float fy = static_cast<float>(y % cell) / static_cast<float>(cell);
      for (int cx = 0; cx * cell < width; ++cx) {
        const auto ux = static_cast<std::uint32_t>(cx);
        const float left = (1 - fy) * hash(ux, cy, octave) + fy * hash(ux, cy + 1, octave);
        const float right = (1 - fy) * hash(ux + 1, cy, octave) + fy * hash(ux + 1, cy + 1, octave);
        float* row = luma.data() + static_cast<std::size_t>(y) * w;
        for (int i = 0, x = cx * cell; i < cell && x < width; ++i, ++x)
          row[x] += amplitude * (left + (right - left) * static_cast<float>(i) / static_cast<float>(cell));
      }
    }
  }
  std::vector<std::uint8_t> rgb(3 * w * h);
  constexpr std::array<float, 3> kTint{1.0f, 1.06f, 0.78f};
  for (std::size_t i = 0; i < w * h; ++i)
    for (std::size_t c = 0; c < 3; ++c)
      rgb[3 * i + c] = static_cast<std::uint8_t>(std::fmin(std::fmax(luma[i] * kTint[c], 0.0f), 255.0f));
  return rgb;
}

}  // namespace overfly::tiling
