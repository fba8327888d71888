#include "tiling/clipmap/improvable.h"

#include <gtest/gtest.h>

#include "tests/unit/index/frames.h"

namespace overfly::tiling {
namespace {

using testing::frame;
using testing::Site;
using testing::siteAt;

TEST(ImprovableTiles, AFrameMarksWhatItSeesAndADuplicateNothingThatIsFull) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48.4, 9.99);
  FrameIndex index(site.lattice);
  index.insert(frame(site, 1, 0, 0, 100));
  const auto first = improvableTiles(index, 1, 20, 400);
  EXPECT_GE(first.size(), 12u);  // 133 x 100 m in tiles of 25 m
  EXPECT_LE(first.size(), FrameIndex::tilesUnder(*index.find(1), 20).size());
  for (const Improvement& tile : first) EXPECT_GT(tile.gain, 0);

  // With room for two views and two good ones there, a third at the same place changes no tile.
  ViewSelectionOptions two;
  two.max_views = 2;
  index.insert(frame(site, 2, 20, 0, 100));
  index.insert(frame(site, 3, 0, 0, 100));
  EXPECT_TRUE(improvableTiles(index, 3, 20, 400, two).empty());
  EXPECT_FALSE(improvableTiles(index, 2, 20, 400, two).empty());
  EXPECT_TRUE(improvableTiles(index, 99, 20, 400).empty());
  index.insert(frame(site, 4, 0, 0, 100, 0, -10));  // oblique
  EXPECT_TRUE(improvableTiles(index, 4, 20, 400).empty());
}

}  // namespace
}  // namespace overfly::tiling
