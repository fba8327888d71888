#pragma once
#include <rapidcheck.h>

#include <cstdint>
#include <random>

#include "tiling/tile.h"

namespace overfly::tiling::testing {

// A tile with holes in every layer, from a seed.
inline Tile tileFromSeed(const geo::TileKey& key, int size, unsigned seed) {
  std::mt19937 random(seed);
  Tile tile = Tile::blank(key, size);
  for (std::size_t i = 0; i < tile.texels(); ++i) {
    if (random() % 4 != 0) {
      for (std::size_t c = 0; c < 3; ++c) tile.color[4 * i + c] = static_cast<std::uint8_t>(random());
      tile.color[4 * i + 3] = 255;
    }
    if (random() % 4 != 0) {
      tile.elevation[i] = static_cast<float>(static_cast<double>(random() % 1000000) / 997.0 - 100.0);
      tile.confidence[i] = static_cast<std::uint8_t>(random());
      tile.views[i] = static_cast<std::uint8_t>(1 + random() % 9);
      tile.kind[i] = static_cast<std::uint8_t>(1U << (random() % 3));
      tile.gsd[i] = static_cast<std::uint8_t>(1 + random() % 255);
      tile.angle[i] = static_cast<std::uint8_t>(1 + random() % 181);
    }
  }
  tile.frame_set = {seed};
  return tile;
}

inline rc::Gen<Tile> randomTile(const geo::TileKey& key, int size) {
  return rc::gen::map(rc::gen::arbitrary<unsigned>(),
                      [=](unsigned seed) { return tileFromSeed(key, size, seed); });
}

}  // namespace overfly::tiling::testing
