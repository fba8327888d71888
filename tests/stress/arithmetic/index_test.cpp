#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <random>

#include "capture/geo/tile_lattice.h"
#include "tests/stress/hard_case/hard_case.h"

// Tile indices where 32 bits end, and places exactly on the lines between tiles.
namespace overfly::geo {
namespace {

TEST(Indices, BeyondThirtyTwoBits) {
  double mistaken = 0;
  for (const std::int64_t edge : {std::int64_t{1} << 30, std::int64_t{1} << 31, std::int64_t{1} << 32})
    for (const std::int64_t sign : {-1, 1})
      for (std::int64_t step = -9; step <= 9; ++step) {
        const TileKey key{28, sign * edge + step, -sign * edge - step};
        for (int i = 0; i < 4; ++i) {
          const TileKey child = childOf(key, i);
          mistaken += parentOf(child) == key ? 0 : 1;
          mistaken += child.x == 2 * key.x + i % 2 && child.y == 2 * key.y + i / 2 ? 0 : 1;
        }
        const TileKey parent = parentOf(key);
        mistaken += static_cast<double>(parent.x) == std::floor(static_cast<double>(key.x) / 2) ? 0 : 1;
      }
  test::expectAtMost("index/int32", "tiles whose parent or child is another one", mistaken, 0);
}

TEST(Indices, ExactlyOnTheLines) {
  std::mt19937_64 random(3);
  double mistaken = 0;
  for (int zoom = 0; zoom <= 28; ++zoom)
    for (int round = 0; round < 200; ++round) {
      std::uniform_int_distribution<std::int64_t> index(-(std::int64_t{2} << zoom), std::int64_t{2} << zoom);
      const TileKey key{zoom, index(random), index(random)};
      mistaken += TileLattice::keyAt(TileLattice::planeOf(key), zoom) == key ? 0 : 1;
      // The line belongs to the tile south-east of it; what lies before it does not.
      const Eigen::Vector2d corner = TileLattice::planeOf(key);
      const Eigen::Vector2d before(std::nextafter(corner.x(), -1e9), std::nextafter(corner.y(), -1e9));
      mistaken += TileLattice::keyAt(before, zoom) == TileKey{zoom, key.x - 1, key.y - 1} ? 0 : 1;
    }
  test::expectAtMost("index/lines", "places on a line, or a bit before it, in another tile", mistaken, 0);
}

}  // namespace
}  // namespace overfly::geo
