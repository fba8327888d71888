#include "tiling/index/frame_index.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>

#include "tests/unit/index/frames.h"

namespace overfly::tiling {
namespace {

using testing::anyFrame;
using testing::frame;
using testing::ids;
using testing::Site;
using testing::siteAt;
using testing::sites;
using testing::uniform;

std::vector<IndexedFrame> someFrames(const Site& site, int most) {
  std::vector<IndexedFrame> frames;
  const int n = *rc::gen::resize(rc::kNominalSize, rc::gen::inRange(0, most));
  for (int i = 0; i < n; ++i) frames.push_back(*anyFrame(site, static_cast<std::uint64_t>(1000 - 7 * i)));
  return frames;
}

// Whether some of many points of the tile, on some of several surfaces, is in the image: a lower bound of
// "touches" that knows nothing of footprints, planes or trees.
bool seesTile(const IndexedFrame& record, const geo::TileLattice& lattice, const geo::TileKey& key,
              double low_m, double high_m) {
  for (int i = 0; i <= 12; ++i)
    for (int j = 0; j <= 12; ++j)
      for (int k = 0; k <= 4; ++k) {
        geo::Geodetic at = lattice.geodeticFromPlane(geo::TileLattice::planeOf(key, i / 12.0, j / 12.0));
        at.height_m = low_m + (high_m - low_m) * k / 4.0;
        const Eigen::Vector3d p = record.pose.ecef_from_camera.conjugate() *
                                  (geo::ecefFromGeodetic(at) - record.pose.position_in_ecef);
        if (const auto pixel = record.camera.project(p))
          if (pixel->x() > 0 && pixel->y() > 0 && pixel->x() < record.camera.width &&
              pixel->y() < record.camera.height)
            return true;
      }
  return false;
}

RC_GTEST_PROP(FrameIndexProperty, noFrameThatSeesATileIsMissedAnywhereOnEarth, ()) {
  const Site site = *rc::gen::elementOf(sites());
  const auto frames = someFrames(site, 25);
  FrameIndex index(site.lattice);
  for (const auto& f : frames) index.insert(f);
  const auto at = site.lattice.planeFromGeodetic(site.centre.lat, site.centre.lon, site.anchor_px);
  const int zoom = *rc::gen::element(15, 17, 19);
  geo::TileKey key = geo::TileLattice::keyAt(*at, zoom);
  key.x += *rc::gen::inRange(-2, 3);
  key.y += *rc::gen::inRange(-2, 3);
  const double low_m = site.centre.height_m + *uniform(-80, 20), high_m = low_m + *uniform(0, 30);
  const auto found = ids(index.framesForTile(key, low_m, high_m));
  RC_ASSERT(std::is_sorted(found.begin(), found.end()));
  for (const auto& f : frames)
    if (f.near_vertical && seesTile(f, site.lattice, key, low_m, high_m))
      RC_ASSERT(std::binary_search(found.begin(), found.end(), f.id));
  // Any copy of the world's x finds the same.
  if (site.lattice.kind() == geo::LatticeKind::WebMercator)
    for (int turn : {-1, 1})
      RC_ASSERT(ids(index.framesForTile({zoom, key.x + (std::int64_t{turn} << zoom), key.y}, low_m,
                                        high_m)) == found);
}

// And none is found that is clearly elsewhere: the outline may at most graze the tile.
RC_GTEST_PROP(FrameIndexProperty, foundFramesSeeTheTileOrItsSurroundings, ()) {
  const Site site = *rc::gen::elementOf(sites());
  FrameIndex index(site.lattice);
  for (const auto& f : someFrames(site, 25)) index.insert(f);
  const auto at = site.lattice.planeFromGeodetic(site.centre.lat, site.centre.lon, site.anchor_px);
  const geo::TileKey key = geo::TileLattice::keyAt(*at, 18);
  const double h = site.centre.height_m;
  for (const IndexedFrame* f : index.framesForTile(key, h, h + 10)) {
    bool near = false;  // at zoom 22 around: a sixteenth of the tile's side
    for (int dx = -1; dx <= 16 && !near; ++dx)
      for (int dy = -1; dy <= 16 && !near; ++dy)
        near = seesTile(*f, site.lattice, {22, 16 * key.x + dx, 16 * key.y + dy}, h, h + 10);
    RC_ASSERT(near);
  }
}

RC_GTEST_PROP(FrameIndexProperty, resultsDoNotDependOnTheOrderOfInsertionsAndCorrections, ()) {
  const Site site = *rc::gen::elementOf(sites());
  auto frames = someFrames(site, 40);
  FrameIndex one(site.lattice), other(site.lattice), packed(site.lattice);
  for (const auto& f : frames) one.insert(f);
  packed.rebuild(frames);
  for (auto f : frames) {  // first at a wrong pose, then corrected; and one that goes away again
    auto moved = *anyFrame(site, f.id);
    other.insert(moved);
  }
  other.insert(frame(site, 5000, 3000, 3000, 150));
  std::reverse(frames.begin(), frames.end());
  for (const auto& f : frames) other.insert(f);
  RC_ASSERT(other.remove(5000));
  RC_ASSERT(!other.remove(5000));
  RC_ASSERT(one.size() == other.size());
  RC_ASSERT(one.area() == other.area());
  RC_ASSERT(one.area() == packed.area());
  RC_ASSERT(ids(one.all()) == ids(other.all()));
  const auto at = site.lattice.planeFromGeodetic(site.centre.lat, site.centre.lon, site.anchor_px);
  const geo::TileKey key = geo::TileLattice::keyAt(*at, 17);
  const double h = site.centre.height_m;
  const auto expected = ids(one.framesForTile(key, h - 20, h + 20));
  RC_ASSERT(ids(other.framesForTile(key, h - 20, h + 20)) == expected);
  RC_ASSERT(ids(packed.framesForTile(key, h - 20, h + 20)) == expected);
}

RC_GTEST_PROP(FrameIndexProperty, boxQueryIsTheBruteForceOne, ()) {
  const Site site = *rc::gen::elementOf(sites());
  const auto frames = someFrames(site, 40);
  FrameIndex index(site.lattice);
  for (const auto& f : frames) index.insert(f);
  const geo::LocalFrame local(site.centre);
  const Eigen::Vector3d middle =
      local.ecefFromEnu({*uniform(-500, 500), *uniform(-500, 500), *uniform(0, 100)});
  const double half = *uniform(1, 300);
  const geo::Box3 box{middle.array() - half, middle.array() + half};
  std::vector<std::uint64_t> expected;
  for (const auto& f : frames)
    if ((f.pyramid_in_ecef.min.array() <= box.max.array()).all() &&
        (f.pyramid_in_ecef.max.array() >= box.min.array()).all())
      expected.push_back(f.id);
  std::sort(expected.begin(), expected.end());
  RC_ASSERT(ids(index.framesInBox(box)) == expected);
}

TEST(FrameIndex, FrustumFindsWhatItSeesAndNotWhatLiesBehind) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48, 9);
  FrameIndex index(site.lattice);
  index.insert(frame(site, 1, 0, 300, 80));          // ahead
  index.insert(frame(site, 2, 0, -300, 80));         // behind
  index.insert(frame(site, 3, 900, 300, 80));        // far to the side
  index.insert(frame(site, 4, 0, 600, 80, 0, -20));  // oblique, ahead
  const geo::LocalFrame local(site.centre);
  std::array<Eigen::Vector3d, 8> corners;
  const double w[] = {1, 400}, y[] = {1, 1000};
  for (std::size_t i = 0; i < 2; ++i) {
    corners[4 * i] = local.ecefFromEnu({-w[i], y[i], 50 + w[i]});
    corners[4 * i + 1] = local.ecefFromEnu({w[i], y[i], 50 + w[i]});
    corners[4 * i + 2] = local.ecefFromEnu({w[i], y[i], 50 - w[i]});
    corners[4 * i + 3] = local.ecefFromEnu({-w[i], y[i], 50 - w[i]});
  }
  EXPECT_EQ(ids(index.framesInFrustum(Frustum::fromCorners(corners))), (std::vector<std::uint64_t>{1, 4}));
}

TEST(FrameIndex, ObliqueFramesAreIndexedButDoNotMakeTheArea) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48, 9);
  FrameIndex index(site.lattice);
  index.insert(frame(site, 1, 0, 0, 100, 0, -10));
  EXPECT_FALSE(index.area());
  EXPECT_FALSE(index.find(1)->near_vertical);
  const auto& box = index.find(1)->pyramid_in_ecef;
  EXPECT_EQ(ids(index.framesInBox({box.min, box.min})).size(), 1u);
  index.insert(frame(site, 2, 0, 0, 100));
  ASSERT_TRUE(index.area());
  const auto alone = *index.area();
  const double metres = site.lattice.metresPerPlaneUnit(site.centre.lat, site.centre.lon);
  EXPECT_NEAR((alone.east - alone.west) * metres, 400.0 / 3, 0.5);
  EXPECT_NEAR((alone.south - alone.north) * metres, 100, 0.5);
  index.insert(frame(site, 3, 1000, 0, 100));
  EXPECT_GT(index.area()->east, alone.east);
  index.remove(3);
  EXPECT_EQ(*index.area(), alone);
}

// Figure 3.10: the range of indices between the corners, of which a turned footprint leaves out the far ones.
TEST(FrameIndex, TilesUnderAFrame) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48.4, 9.99);
  const auto straight = frame(site, 1, 0, 0, 100), turned = frame(site, 2, 0, 0, 100, 45);
  for (const auto& f : {straight, turned}) {
    std::vector<geo::TileKey> expected;
    const int zoom = 21;
    const geo::TileKey middle = geo::TileLattice::keyAt(f.nadir, zoom);
    for (std::int64_t x = middle.x - 12; x <= middle.x + 12; ++x)
      for (std::int64_t y = middle.y - 12; y <= middle.y + 12; ++y)
        if (seesTile(f, site.lattice, {zoom, x, y}, f.ground_height_m, f.ground_height_m))
          expected.push_back({zoom, x, y});
    const auto keys = FrameIndex::tilesUnder(f, zoom);
    EXPECT_TRUE(std::includes(keys.begin(), keys.end(), expected.begin(), expected.end()));
    EXPECT_LE(keys.size(), expected.size() + 4);  // corners that a grid of 13 x 13 points does not meet
  }
}

TEST(IndexedFrame, UnusableFramesAreRefused) {
  const Site site = siteAt(geo::TileLattice::webMercator(), 48, 9);
  auto pose = frame(site, 1, 0, 0, 100).pose;
  auto model = testing::camera();
  model.fx = 0;
  EXPECT_FALSE(makeIndexedFrame(1, model, pose, 0, site.lattice, 0.5, 400));
  pose.position_in_ecef.setZero();
  EXPECT_FALSE(makeIndexedFrame(1, testing::camera(), pose, 0, site.lattice, 0.5, 400));
  pose.position_in_ecef.x() = std::nan("");
  EXPECT_FALSE(makeIndexedFrame(1, testing::camera(), pose, 0, site.lattice, 0.5, 400));
}

// The flat-Earth scaling about the nadir against the footprint that is computed at that height.
RC_GTEST_PROP(IndexedFrameProperty, footprintAtAnotherHeightIsTheComputedOne, ()) {
  const Site site = *rc::gen::elementOf(sites());
  const IndexedFrame record = *anyFrame(site, 1);
  RC_PRE(record.near_vertical);
  const double height_m = record.ground_height_m + *uniform(-100, 15);
  const auto exact = geo::footprint(record.camera, record.pose, height_m);
  RC_ASSERT(exact.has_value());
  const auto scaled = record.footprintAt(height_m);
  const double metres = site.lattice.metresPerPlaneUnit(site.centre.lat, site.centre.lon);
  for (std::size_t i = 0; i < 4; ++i) {
    const auto plane =
        site.lattice.planeFromGeodetic(exact->corners[i].lat, exact->corners[i].lon, record.nadir.x());
    RC_ASSERT((scaled[i] - *plane).norm() * metres < 0.1);
  }
}

}  // namespace
}  // namespace overfly::tiling
