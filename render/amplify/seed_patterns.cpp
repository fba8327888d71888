#include "render/amplify/seed_patterns.h"

#include <algorithm>

namespace overfly::amplify {
namespace {

// Distance on the torus of side 65536, squared.
std::uint64_t squaredDistance(const PatternSeed& a, const PatternSeed& b) {
  const auto dx = static_cast<std::int16_t>(static_cast<std::uint16_t>(a.x - b.x));
  const auto dy = static_cast<std::int16_t>(static_cast<std::uint16_t>(a.y - b.y));
  return static_cast<std::uint64_t>(static_cast<std::int64_t>(dx) * dx + static_cast<std::int64_t>(dy) * dy);
}

}  // namespace

SeedPatterns::SeedPatterns(std::uint32_t seed) {
  std::uint32_t state = seed % 2147483646u + 1;
  const auto draw = [&state] {
    state = parkMiller(state);
    return static_cast<std::uint16_t>(state >> 15);
  };
  constexpr int kCandidates = 24;
  seeds_.reserve(static_cast<std::size_t>(kPatterns * kSeeds));
  for (int pattern = 0; pattern < kPatterns; ++pattern) {
    const std::size_t first = seeds_.size();
    for (int i = 0; i < kSeeds; ++i) {
      PatternSeed best;
      std::uint64_t best_distance = 0;
      for (int candidate = 0; candidate < kCandidates; ++candidate) {
        PatternSeed tried;
        tried.x = draw();
        tried.y = draw();
        std::uint64_t nearest = ~std::uint64_t{0};
        for (std::size_t k = first; k < seeds_.size(); ++k) {
          nearest = std::min(nearest, squaredDistance(tried, seeds_[k]));
        }
        if (candidate == 0 || nearest > best_distance) {
          best = tried;
          best_distance = nearest;
        }
      }
      seeds_.push_back(best);
    }
  }
}

int SeedPatterns::patternOf(int tile_x, int tile_y, std::uint32_t seed) {
  const std::uint32_t place = static_cast<std::uint32_t>(tile_x) * 0x9e3779b1u ^
                              static_cast<std::uint32_t>(tile_y) * 0x85ebca77u ^ seed;
  std::uint32_t state = place % 2147483646u + 1;
  for (int i = 0; i < 3; ++i) state = parkMiller(state);
  return static_cast<int>((state >> 8) % kPatterns);
}

}  // namespace overfly::amplify
