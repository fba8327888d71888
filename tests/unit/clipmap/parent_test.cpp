#include "tiling/clipmap/parent.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <cmath>

#include "tests/unit/clipmap/random_tile.h"

namespace overfly::tiling {
namespace {

using testing::randomTile;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

Tile flat(float height, std::uint8_t grey) {
  Tile tile = Tile::blank({10, 0, 0}, 4);
  for (std::size_t i = 0; i < tile.texels(); ++i) {
    tile.elevation[i] = height;
    tile.kind[i] = kMeasured;
    for (std::size_t c = 0; c < 3; ++c) tile.color[4 * i + c] = grey;
    tile.color[4 * i + 3] = 255;
  }
  return tile;
}

TEST(MakeParent, EachChildFillsItsQuadrant) {
  const Tile a = flat(1, 10), b = flat(2, 20), c = flat(3, 30), d = flat(4, 40);
  const Tile parent = makeParent({9, 0, 0}, {&a, &b, &c, &d});
  EXPECT_EQ(parent.size, 4);
  EXPECT_EQ(parent.elevation, (std::vector<float>{1, 1, 2, 2, 1, 1, 2, 2, 3, 3, 4, 4, 3, 3, 4, 4}));
  EXPECT_EQ(parent.color[0], 10);
  EXPECT_EQ(parent.color[4 * 3], 20);
  EXPECT_EQ(parent.color[4 * 12], 30);
  EXPECT_EQ(parent.color[4 * 15], 40);
  EXPECT_TRUE(parent.frame_set.empty());
  EXPECT_TRUE(parent.source.empty());
}

TEST(MakeParent, OnlyWhatIsValidIsAveraged) {
  Tile a = flat(10, 100);
  a.elevation = {1,    kNan, 5, 6,  //
                 kNan, 2,    7, 8,  //
                 kNan, kNan, 1, 1, kNan, kNan, 1, 1};
  a.color[3] = 0;    // texel (0, 0) without colour
  a.color[0] = 255;  // whose value must not count
  a.color[4] = 101;  // (1, 0)
  for (std::size_t i : {10u, 11u, 14u, 15u}) a.color[4 * i + 3] = 0;
  a.kind[5] = kFilled;
  const Tile parent = makeParent({9, 0, 0}, {&a, nullptr, nullptr, nullptr});
  EXPECT_EQ(parent.elevation[0], 1.5F);
  EXPECT_EQ(parent.elevation[1], 6.5F);
  EXPECT_TRUE(std::isnan(parent.elevation[4]));
  EXPECT_TRUE(std::isnan(parent.elevation[15]));
  EXPECT_EQ(parent.color[0], 100);  // (101 + 100 + 100 + 1) / 3
  EXPECT_EQ(parent.color[3], 255);
  EXPECT_EQ(parent.color[4 * 5 + 3], 0);
  EXPECT_EQ(parent.kind[0], kMeasured | kFilled);
  EXPECT_EQ(parent.kind[15], kNoData);
}

TEST(MakeParent, OfNothingIsEmpty) {
  EXPECT_TRUE(makeParent({9, 0, 0}, {}).empty());
  const Tile blank = Tile::blank({10, 1, 0}, 4);
  EXPECT_TRUE(makeParent({9, 0, 0}, {nullptr, &blank, nullptr, nullptr}).empty());
}

// Half of the tiles are opaque, where the mean is taken two channels at a time.
RC_GTEST_PROP(MakeParentProperty, joinedHalvesAreTheParent, ()) {
  std::array<Tile, 4> children, halves;
  std::array<const Tile*, 4> pointers{}, half_pointers{};
  for (std::size_t q = 0; q < 4; ++q) {
    if (*rc::gen::inRange(0, 4) == 0) continue;
    children[q] = *randomTile({11, static_cast<int>(q & 1), static_cast<int>(q >> 1)}, 8);
    children[q].elevation.clear();
    if (*rc::gen::arbitrary<bool>())
      for (std::size_t i = 3; i < children[q].color.size(); i += 4) children[q].color[i] = 255;
    halves[q] = halved(children[q]);
    RC_ASSERT(halves[q].size == 4);
    pointers[q] = &children[q];
    half_pointers[q] = &halves[q];
  }
  const Tile parent = makeParent({10, 0, 0}, pointers);
  RC_ASSERT(joinHalves({10, 0, 0}, half_pointers) == parent);
  // Whatever the memory held that they are made in.
  Tile used = *randomTile({3, 1, 2}, 8);
  used.frame_set = {1, 2};
  RC_ASSERT(joinHalves({10, 0, 0}, half_pointers, Tile(used)) == parent);
  for (std::size_t q = 0; q < 4; ++q)
    RC_ASSERT(pointers[q] == nullptr || halved(children[q], Tile(used)) == halves[q]);
  for (std::size_t q = 0; q < 4; ++q)
    for (std::size_t i = 0; pointers[q] != nullptr && i < 16; ++i) {
      const std::size_t out = (4 * (q >> 1) + i / 4) * 8 + 4 * (q & 1) + i % 4;
      unsigned sum = 0, count = 0;
      for (const std::size_t in : {0U, 1U, 8U, 9U}) {
        const std::size_t at = 4 * (i / 4 * 16 + i % 4 * 2 + in);
        if (children[q].color[at + 3] == 0) continue;
        sum += children[q].color[at + 1];
        ++count;
      }
      if (count != 0) RC_ASSERT(parent.color[4 * out + 1] == (sum + count / 2) / count);
    }
}

// Whatever lies between four texel centres, at every finer level, is below the bound of the texel above it.
RC_GTEST_PROP(MakeParentProperty, theBoundLiesAboveEveryFinerSurface, ()) {
  std::array<Tile, 4> children;
  std::array<const Tile*, 4> pointers{};
  for (std::size_t i = 0; i < 4; ++i) {
    std::array<Tile, 4> finer;
    std::array<const Tile*, 4> finer_pointers{};
    for (std::size_t j = 0; j < 4; ++j) {
      finer[j] = *randomTile({12, 0, 0}, 8);
      finer_pointers[j] = &finer[j];
    }
    children[i] = makeParent({11, 0, 0}, finer_pointers);
    pointers[i] = &children[i];
    const auto bound = elevationMax(children[i]);
    for (std::size_t j = 0; j < 4; ++j)
      for (std::size_t row = 0; row < 8; ++row)
        for (std::size_t column = 0; column < 8; ++column) {
          const float h = finer[j].elevation[row * 8 + column];
          const std::size_t above = (4 * (j >> 1) + row / 2) * 8 + 4 * (j & 1) + column / 2;
          if (!std::isnan(h)) RC_ASSERT(bound[above] >= h);
        }
  }
  const auto top = elevationMax(makeParent({10, 0, 0}, pointers));
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t row = 0; row < 8; ++row)
      for (std::size_t column = 0; column < 8; ++column) {
        const float finer = elevationMax(children[i])[row * 8 + column];
        const std::size_t above = (4 * (i >> 1) + row / 2) * 8 + 4 * (i & 1) + column / 2;
        if (!std::isnan(finer)) RC_ASSERT(top[above] >= finer);
      }
}

RC_GTEST_PROP(ElevationMaxProperty, bilinearSurfaceLiesBelow, ()) {
  const Tile tile = *randomTile({12, 0, 0}, 8);
  const auto bound = elevationMax(tile);
  for (int k = 0; k < 200; ++k) {
    const double x = *rc::gen::inRange(0, 7000) / 1000.0, y = *rc::gen::inRange(0, 7000) / 1000.0;
    const auto column = static_cast<std::size_t>(x), row = static_cast<std::size_t>(y);
    const auto h = [&](std::size_t c, std::size_t r) {
      return static_cast<double>(tile.elevation[r * 8 + c]);
    };
    const double fx = x - static_cast<double>(column), fy = y - static_cast<double>(row);
    const double surface = (1 - fy) * ((1 - fx) * h(column, row) + fx * h(column + 1, row)) +
                           fy * ((1 - fx) * h(column, row + 1) + fx * h(column + 1, row + 1));
    // The texel whose square holds the point: its centre is the nearest one.
    const auto nearest =
        static_cast<std::size_t>(std::lround(y)) * 8 + static_cast<std::size_t>(std::lround(x));
    if (!std::isnan(surface)) RC_ASSERT(static_cast<double>(bound[nearest]) >= surface - 1e-9);
  }
}

TEST(GsdCode, StepsOfFourPercent) {
  for (double gsd : {0.001, 0.0123, 0.05, 0.2, 1.7, 50.0})
    EXPECT_NEAR(gsdFromCode(gsdCode(gsd)) / gsd, 1, 0.023) << gsd;
  EXPECT_EQ(gsdCode(0), 0);
  EXPECT_EQ(gsdCode(std::nan("")), 0);
  EXPECT_EQ(gsdCode(1e9), 255);
  EXPECT_EQ(gsdCode(1e-9), 1);
  EXPECT_TRUE(std::isnan(gsdFromCode(0)));
}

TEST(Tile, EqualityIsBitForBit) {
  Tile a = Tile::blank({10, 0, 0}, 4), b = a;
  EXPECT_EQ(a, b);  // NaN equals NaN
  b.elevation[3] = 1;
  EXPECT_FALSE(a == b);
  EXPECT_TRUE(a.empty());
  EXPECT_FALSE(b.empty());
  EXPECT_FALSE(highest(a));
  EXPECT_EQ(highest(b), 1.0F);
  EXPECT_EQ(lowest(b), 1.0F);
}

}  // namespace
}  // namespace overfly::tiling
