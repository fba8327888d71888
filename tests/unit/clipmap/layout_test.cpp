#include "tiling/clipmap/layout.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <cmath>

namespace overfly::tiling {
namespace {

using geo::TileKey;
using ::testing::ElementsAre;

// Area in cells of level 0, so that the figures' indices can be written down; zoom 20.
constexpr int kZoom = 20;
PlaneBox cells(double west, double north, double east, double south) {
  const double unit = std::ldexp(1.0, -kZoom);
  return {west * unit, north * unit, east * unit, south * unit};
}

// Plane coordinates as a map has them: anywhere in the world, far from the origin, or around it.
rc::Gen<PlaneBox> anyArea() {
  return rc::gen::map(
      rc::gen::resize(rc::kNominalSize,
                      rc::gen::tuple(rc::gen::inRange(0, 3), rc::gen::inRange(-1 << 20, 1 << 20),
                                     rc::gen::inRange(-1 << 20, 1 << 20), rc::gen::inRange(0, 1 << 12),
                                     rc::gen::inRange(0, 1 << 12), rc::gen::inRange(0, 12))),
      [](const std::tuple<int, int, int, int, int, int>& t) {
        const auto [where, x, y, w, h, shrink] = t;
        const double x0 = where == 0 ? x / 1024.0 : x, y0 = where == 0 ? y / 1024.0 : y;
        const double width = std::ldexp(w, -shrink), height = std::ldexp(h, -shrink);
        return cells(x0, y0, x0 + width, y0 + height);
      });
}

// By brute force from the definition: real floors at every level from 0.
RC_GTEST_PROP(LayoutProperty, levelsAreTheSmallestThatCoverByTwoByTwo, ()) {
  const PlaneBox area = *anyArea();
  const Layout layout(kZoom, area);
  const auto index = [](double p, int level) { return std::floor(std::ldexp(p, kZoom - level)); };
  int level = 0;
  while (index(area.east, level) - index(area.west, level) > 1 ||
         index(area.south, level) - index(area.north, level) > 1)
    ++level;
  RC_ASSERT(layout.levels() == level + 2);
  // The top's four children cover the area.
  const TopTile top = *layout.top();
  RC_ASSERT(top.north_west.zoom == kZoom - level);
  for (double x : {area.west, area.east})
    for (double y : {area.north, area.south})
      RC_ASSERT(top.hasChild(geo::TileLattice::keyAt({x, y}, kZoom - level)));
}

// (3.5) agrees with (3.1) below level L-2, and leads to the top at L-2.
RC_GTEST_PROP(LayoutProperty, everyTileOfTheAreaHasAParentUpToTheTop, ()) {
  const PlaneBox area = *anyArea();
  const Layout layout(kZoom, area);
  TileKey key = geo::TileLattice::keyAt({area.west, area.south}, kZoom);
  for (int level = 0; level < layout.levels() - 2; ++level) {
    RC_ASSERT(layout.range(level).contains(key));
    const auto parent = layout.parent(key);
    RC_ASSERT(parent.has_value());
    RC_ASSERT(*parent == geo::TileLattice::keyAt({area.west, area.south}, kZoom - level - 1));
    key = *parent;
  }
  RC_ASSERT(!layout.parent(key));
  RC_ASSERT(layout.top()->hasChild(key));
}

RC_GTEST_PROP(LayoutProperty, growingInAnyOrderAndDirectionEndsInTheSameLayout, ()) {
  const auto areas = *rc::gen::container<std::vector<PlaneBox>>(4, anyArea());
  Layout forward(kZoom), backward(kZoom);
  for (const auto& a : areas) {
    const Layout next = forward.grown(a);
    RC_ASSERT(next.levels() >= forward.levels());
    const Growth g = growth(forward, next);
    RC_ASSERT(g.added_levels == next.levels() - forward.levels());
    // Every former child of the top has all its ancestors up to the new level L-2 among the parents to make.
    if (forward.top())
      for (int i = 0; i < 4; ++i) {
        TileKey key = forward.top()->child(i);
        while (const auto parent = next.parent(key)) {
          RC_ASSERT(std::count(g.parents.begin(), g.parents.end(), *parent) == 1);
          key = *parent;
        }
      }
    forward = next;
  }
  for (auto it = areas.rbegin(); it != areas.rend(); ++it) backward = backward.grown(*it);
  RC_ASSERT(forward.levels() == backward.levels());
  RC_ASSERT(forward.top() == backward.top());
}

// Figure 3.7: indices start from the origin on both sides of it; each 2x2 of level l are one at l+1.
TEST(Layout, Figure37) {
  const Layout layout(kZoom, cells(-3.5, -2.5, 3.5, 2.5));
  EXPECT_EQ(layout.range(0), (TileRange{kZoom, -4, -3, 3, 2}));
  EXPECT_EQ(layout.range(1), (TileRange{kZoom - 1, -2, -2, 1, 1}));
  EXPECT_EQ(layout.range(2), (TileRange{kZoom - 2, -1, -1, 0, 0}));
  EXPECT_EQ(layout.levels(), 4);
  // The top holds the origin in its middle: no lattice cell does.
  EXPECT_EQ(layout.top()->north_west, (TileKey{kZoom - 2, -1, -1}));
  EXPECT_EQ(*layout.parent({kZoom, -1, -3}), (TileKey{kZoom - 1, -1, -2}));
  EXPECT_FALSE(layout.parent({kZoom - 2, -1, 0}));
}

// The text's example to figure 3.7: a top of (1,-1), (2,-1), (1,0), (2,0), of four different lattice parents.
TEST(Layout, TopOfChildrenThatAreNoSiblings) {
  const Layout layout(kZoom, cells(1.2, -0.8, 2.9, 0.7));
  EXPECT_EQ(layout.levels(), 2);
  const TopTile top = *layout.top();
  EXPECT_EQ(top.child(0), (TileKey{kZoom, 1, -1}));
  EXPECT_EQ(top.child(1), (TileKey{kZoom, 2, -1}));
  EXPECT_EQ(top.child(2), (TileKey{kZoom, 1, 0}));
  EXPECT_EQ(top.child(3), (TileKey{kZoom, 2, 0}));
  EXPECT_EQ(geo::parentOf(top.child(0)), (TileKey{kZoom - 1, 0, -1}));
  EXPECT_EQ(geo::parentOf(top.child(1)), (TileKey{kZoom - 1, 1, -1}));
  EXPECT_EQ(geo::parentOf(top.child(2)), (TileKey{kZoom - 1, 0, 0}));
  EXPECT_EQ(geo::parentOf(top.child(3)), (TileKey{kZoom - 1, 1, 0}));
}

// Figure 3.8: a frame outside the area adds a level; the tiles between are empty and are not named as work.
TEST(Layout, Figure38) {
  const Layout before(kZoom, cells(0.2, 0.2, 1.8, 1.8));
  EXPECT_EQ(before.levels(), 2);
  const Layout after = before.grown(cells(3.1, 3.1, 3.9, 3.9));
  EXPECT_EQ(after.levels(), 3);
  EXPECT_EQ(after.top()->north_west, (TileKey{kZoom - 1, 0, 0}));
  const Growth g = growth(before, after);
  EXPECT_EQ(g.added_levels, 1);
  EXPECT_TRUE(g.top_changed);
  EXPECT_THAT(g.parents, ElementsAre(TileKey{kZoom - 1, 0, 0}));
}

// Figure 3.9: the former top's children go to different parents.
TEST(Layout, Figure39) {
  const Layout before(kZoom, cells(1.2, -0.8, 2.9, 0.7));
  const Layout after = before.grown(cells(-0.5, -0.8, 2.9, 0.7));
  EXPECT_EQ(after.levels(), 4);  // columns -1..1 at level 1, so 2x2 at level 2
  const Growth g = growth(before, after);
  EXPECT_EQ(g.added_levels, 2);
  EXPECT_THAT(g.parents,
              ElementsAre(TileKey{kZoom - 1, 0, -1}, TileKey{kZoom - 1, 0, 0}, TileKey{kZoom - 1, 1, -1},
                          TileKey{kZoom - 1, 1, 0}, TileKey{kZoom - 2, 0, -1}, TileKey{kZoom - 2, 0, 0}));
}

TEST(Layout, GrowthByManyLevelsInOneStepInEveryDirection) {
  const Layout before(kZoom, cells(500.5, 300.5, 500.9, 300.9));
  EXPECT_EQ(before.levels(), 2);
  for (const PlaneBox& far : {cells(4000, 300, 4001, 301), cells(-4000, 300, -3999, 301),
                              cells(500, 5000, 501, 5001), cells(500, -5000, 501, -4999)}) {
    const Layout after = before.grown(far);
    EXPECT_GE(after.levels(), 12);
    const Growth g = growth(before, after);
    EXPECT_EQ(g.added_levels, after.levels() - 2);
    EXPECT_EQ(g.parents.size(), static_cast<std::size_t>(after.levels() - 2));
  }
}

// Far from the origin (3.3) literally has no solution: the corners share every coarser cell.
TEST(Layout, ASmallAreaFarFromTheOriginHasTwoLevels) {
  const Layout layout(22, {0.5277, 0.3460, 0.5277 + 1e-9, 0.3460 + 1e-9});
  EXPECT_EQ(layout.levels(), 2);
  EXPECT_EQ(geo::parentOf(layout.top()->child(0)), geo::parentOf(layout.top()->child(3)));
}

TEST(Layout, NothingCovered) {
  const Layout layout(kZoom);
  EXPECT_EQ(layout.levels(), 0);
  EXPECT_FALSE(layout.top());
  EXPECT_FALSE(layout.parent({kZoom, 0, 0}));
}

}  // namespace
}  // namespace overfly::tiling
