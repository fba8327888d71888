#pragma once
#include <cstdint>
#include <vector>

namespace overfly::amplify {

// Seeds of one square pattern, in 1/65536 of its side; in such an order that every prefix is spread evenly
// (each point is the best of several candidates, distances taken on the torus), so that a density takes a
// prefix and never a thinning.
struct PatternSeed {
  std::uint16_t x = 0;
  std::uint16_t y = 0;
};

// The generic patterns of Amara et al. (section 2.2, 4.2): kPatterns squares of kSeeds seeds, laid
// aperiodically over a regular grid of tiles. Value type, reentrant.
class SeedPatterns {
 public:
  static constexpr int kPatterns = 16;
  static constexpr int kSeeds = 128;
  static constexpr double kTileMetres = 32;  // side of a tile; 128 seeds: at most 1,250 plants per hectare

  explicit SeedPatterns(std::uint32_t seed);

  [[nodiscard]] const std::vector<PatternSeed>& seeds() const { return seeds_; }  // pattern after pattern
  [[nodiscard]] const PatternSeed& at(int pattern, int index) const {
    return seeds_[static_cast<std::size_t>(pattern * kSeeds + index)];
  }

  // Pattern (0..kPatterns-1) of a tile: the minimal standard generator of Park and Miller [20], advanced
  // from a state that the tile's place makes: coherent in space, without a period on the ground.
  [[nodiscard]] static int patternOf(int tile_x, int tile_y, std::uint32_t seed);

 private:
  std::vector<PatternSeed> seeds_;
};

// x -> 16807 x mod (2^31 - 1), Park and Miller 1988; state in 1..2^31-2.
[[nodiscard]] constexpr std::uint32_t parkMiller(std::uint32_t state) {
  return static_cast<std::uint32_t>((static_cast<std::uint64_t>(state) * 16807u) % 2147483647u);
}

}  // namespace overfly::amplify
