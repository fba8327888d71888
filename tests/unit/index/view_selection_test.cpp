#include "tiling/index/view_selection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "tests/unit/index/frames.h"
#include "tiling/index/detail/convex.h"

namespace overfly::tiling {
namespace {

using testing::anyFrame;
using ::testing::ElementsAre;
using testing::frame;
using ::testing::IsEmpty;
using testing::Site;
using testing::siteAt;
using testing::sites;
using testing::uniform;

std::vector<const IndexedFrame*> pointers(const std::vector<IndexedFrame>& frames) {
  std::vector<const IndexedFrame*> result;
  for (const auto& f : frames) result.push_back(&f);
  return result;
}

geo::TileKey tileAt(const Site& site, int zoom) {
  return geo::TileLattice::keyAt(
      *site.lattice.planeFromGeodetic(site.centre.lat, site.centre.lon, site.anchor_px), zoom);
}

RC_GTEST_PROP(ViewSelectionProperty, dependsOnTheSetOnly, ()) {
  const Site site = *rc::gen::elementOf(sites());
  std::vector<IndexedFrame> frames;
  for (int i = 0; i < 20; ++i) frames.push_back(*anyFrame(site, static_cast<std::uint64_t>(i)));
  auto order = pointers(frames);
  const geo::TileKey key = tileAt(site, 18);
  const auto first = selectViews(order, site.lattice, key, site.centre.height_m);
  std::shuffle(order.begin(), order.end(), std::mt19937(*rc::gen::arbitrary<unsigned>()));
  order.push_back(order.front());
  const auto second = selectViews(order, site.lattice, key, site.centre.height_m);
  RC_ASSERT(first.size() == second.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    RC_ASSERT(first[i].id == second[i].id);
    RC_ASSERT(first[i].gain == second[i].gain);
    RC_ASSERT(first[i].overlap >= 0.01 && first[i].overlap <= 1 + 1e-9);
    RC_ASSERT(first[i].obliqueness <= 0.7);
  }
  std::set<std::uint64_t> distinct;
  for (const auto& view : first) distinct.insert(view.id);
  RC_ASSERT(distinct.size() == first.size());
  RC_ASSERT(first.size() <= 12u);
}

// A copy of the world to the side sees the same views.
TEST(ViewSelection, TheTilesCopyOfTheWorldDoesNotMatter) {
  const Site site = siteAt(geo::TileLattice::webMercator(), -16.5, 180);
  std::vector<IndexedFrame> frames;
  for (int i = 0; i < 5; ++i) frames.push_back(frame(site, static_cast<std::uint64_t>(i), 20 * i, 5, 100));
  const geo::TileKey key = tileAt(site, 19);
  const auto here = selectViews(pointers(frames), site.lattice, key, 400);
  const auto there = selectViews(pointers(frames), site.lattice, site.lattice.wrapped(key), 400);
  ASSERT_EQ(here.size(), 5u);
  ASSERT_EQ(there.size(), 5u);
  for (std::size_t i = 0; i < 5; ++i) EXPECT_EQ(here[i].id, there[i].id);
}

TEST(ViewSelection, TheSecondViewIsTheOneWithAParallax) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48, 9);
  // 1 straight above, 2 almost the same place, 3 a good base (11 deg).
  const std::vector<IndexedFrame> frames = {frame(site, 1, 0, 0, 100), frame(site, 2, 0.2, 0, 100),
                                            frame(site, 3, 20, 0, 100)};
  ViewSelectionOptions options;
  options.max_views = 2;
  const auto views = selectViews(pointers(frames), site.lattice, tileAt(site, 22), 400, options);
  ASSERT_EQ(views.size(), 2u);
  EXPECT_EQ(views[1].id, 3u);
}

TEST(ViewSelection, CoverageComesBeforeMoreOfTheSame) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48, 9);
  const geo::TileKey key = tileAt(site, 19);  // 51 m
  const geo::Geodetic middle = site.lattice.geodeticFromPlane(geo::TileLattice::planeOf(key, 0.5, 0.5));
  const Site there = siteAt(site.lattice, geo::degrees(middle.lat), geo::degrees(middle.lon));
  // At 30 m a footprint is 40 x 30 m: 1..3 over the west half, 4 over the east half and less sharp.
  std::vector<IndexedFrame> frames;
  for (int i = 0; i < 3; ++i)
    frames.push_back(frame(there, static_cast<std::uint64_t>(i + 1), -14, 2 * i, 30, 0, -90, 0, 10));
  frames.push_back(frame(there, 4, 22, 0, 30, 0, -90, 0, 8));
  ViewSelectionOptions options;
  options.max_views = 2;
  const auto views = selectViews(pointers(frames), site.lattice, key, 400, options);
  ASSERT_EQ(views.size(), 2u);
  EXPECT_EQ(views[1].id, 4u);
}

TEST(ViewSelection, SharperNearerAndSteeperIsBetter) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48, 9);
  const geo::TileKey key = tileAt(site, 22);
  ViewSelectionOptions options;
  options.max_views = 1;
  const auto best = [&](const std::vector<IndexedFrame>& frames) {
    return selectViews(pointers(frames), site.lattice, key, 400, options).at(0).id;
  };
  EXPECT_EQ(best({frame(site, 1, 0, 0, 100, 0, -90, 0, 5), frame(site, 2, 0, 0, 100, 0, -90, 0, 9)}), 2u);
  EXPECT_EQ(best({frame(site, 1, 0, 0, 100), frame(site, 2, 0, 0, 60)}), 2u);
  EXPECT_EQ(best({frame(site, 1, 40, 0, 100), frame(site, 2, 0, 0, 100)}), 2u);
  EXPECT_EQ(best({frame(site, 2, 0, 0, 100), frame(site, 1, 0, 0, 100)}), 1u);  // a tie: the lower id
}

TEST(ViewSelection, NothingFromNowhere) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48, 9);
  EXPECT_THAT(selectViews({}, site.lattice, tileAt(site, 20), 400), IsEmpty());
  const std::vector<IndexedFrame> frames = {frame(site, 1, 2000, 0, 100), frame(site, 2, 0, 0, 100, 0, -20)};
  EXPECT_THAT(selectViews(pointers(frames), site.lattice, tileAt(site, 20), 400), IsEmpty());
  const std::vector<IndexedFrame> under = {frame(site, 1, 0, 0, 100)};
  EXPECT_THAT(selectViews(pointers(under), site.lattice, tileAt(site, 20), 600), IsEmpty());
}

// Figure 5.3: B overlaps A and C, which do not overlap each other.
TEST(DistributeViews, Figure53) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48, 9);
  const std::vector<IndexedFrame> frames = {frame(site, 10, -100, 0, 100), frame(site, 11, 0, 0, 100),
                                            frame(site, 12, 100, 0, 100)};
  EXPECT_THAT(distributeViews(pointers(frames), 400, 2),
              ElementsAre(ElementsAre(10u, 11u), ElementsAre(12u, 11u)));
}

TEST(DistributeViews, AFrameThatOverlapsNoneIsLeftOut) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48, 9);
  const std::vector<IndexedFrame> frames = {frame(site, 1, 0, 0, 100), frame(site, 2, 30, 0, 100),
                                            frame(site, 3, 900, 0, 100)};
  EXPECT_THAT(distributeViews(pointers(frames), 400, 8), ElementsAre(ElementsAre(1u, 2u)));
}

RC_GTEST_PROP(DistributeViewsProperty, everyOverlappingFrameIsInASetOfFramesThatOverlapItsFirst, ()) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48, 9);
  std::vector<IndexedFrame> frames;
  const int n = *rc::gen::resize(rc::kNominalSize, rc::gen::inRange(0, 30));
  for (int i = 0; i < n; ++i) frames.push_back(*anyFrame(site, static_cast<std::uint64_t>(i)));
  const int most = *rc::gen::inRange(2, 8);
  const auto sets = distributeViews(pointers(frames), 400, most, 0.05);
  std::set<std::uint64_t> covered;
  RC_ASSERT(sets.size() <= frames.size());
  const auto common = [&](std::uint64_t a, std::uint64_t b) {
    const geo::TileKey unit{20, 0, 0};
    return detail::area(detail::intersection(detail::footprintInTile(frames[a], 400, unit),
                                             detail::footprintInTile(frames[b], 400, unit)));
  };
  const auto areaOf = [&](std::uint64_t a) { return common(a, a); };
  for (const auto& set : sets) {
    RC_ASSERT(set.size() >= 2u && set.size() <= static_cast<std::size_t>(most));
    for (std::size_t i = 1; i < set.size(); ++i)
      RC_ASSERT(common(set[0], set[i]) > 0.049 * std::min(areaOf(set[0]), areaOf(set[i])));
    covered.insert(set.begin(), set.end());
  }
  for (std::size_t a = 0; a < frames.size(); ++a)
    for (std::size_t b = 0; b < frames.size(); ++b)
      if (a != b && frames[a].near_vertical && frames[b].near_vertical &&
          common(a, b) > 0.051 * std::min(areaOf(a), areaOf(b)))
        RC_ASSERT(covered.count(a) == 1u);
}

// Areas by clipping against areas by counting.
RC_GTEST_PROP(ConvexProperty, intersectionAreaAgreesWithSampling, ()) {
  const auto quad = [] {
    const double angle = *uniform(0, 6.28), rx = *uniform(0.3, 2), ry = *uniform(0.3, 2);
    const Eigen::Vector2d centre(*uniform(-1, 1), *uniform(-1, 1));
    const double turn = *rc::gen::element(1.0, -1.0);
    detail::Polygon polygon;
    for (int i = 0; i < 4; ++i)
      polygon.push_back(centre + Eigen::Vector2d(rx * std::cos(angle + turn * i * 1.5707963),
                                                 ry * std::sin(angle + turn * i * 1.5707963)));
    return polygon;
  };
  const auto a = quad(), b = quad();
  const auto both = detail::intersection(a, b);
  int inside = 0;
  const int n = 200;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      const Eigen::Vector2d p(-3 + 6.0 * (i + 0.5) / n, -3 + 6.0 * (j + 0.5) / n);
      inside += detail::contains(a, p) && detail::contains(b, p) ? 1 : 0;
    }
  RC_ASSERT(std::abs(detail::area(both) - 36.0 * inside / (n * n)) < 0.12);
}

}  // namespace
}  // namespace overfly::tiling
