#include "capture/geo/tile_frame.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>

#include "tests/unit/geo/globe.h"

namespace overfly::geo {
namespace {

using testing::integer;
using testing::place;
using testing::Place;
using testing::uniform;

TileFrame frameAt(const Place& p, int zoom) {
  return TileFrame(p.lattice, TileLattice::keyAt(*p.lattice.planeFromGeodetic(p.lat, p.lon), zoom));
}

RC_GTEST_PROP(TileFrameProperty, polynomialWithinATenthOfAMillimetreApronIncluded, ()) {
  const Place p = *place();
  const TileFrame frame = frameAt(p, *integer(10, 29));
  for (const double h : {-500.0, *uniform(-500, 9000), 9000.0})
    for (const auto& [u, v] : {std::pair{0.0, 0.0},
                               {1.0, 0.0},
                               {-0.5, 1.5},
                               {1.5, 1.5},
                               {0.5, 0.5},
                               {*uniform(-0.5, 1.5), *uniform(-0.5, 1.5)}})
      RC_ASSERT((frame.enuFromTexel(u, v, h) - frame.enuFromTexelExact(u, v, h)).norm() < 1e-4);
}

RC_GTEST_PROP(TileFrameProperty, texelCoordinatesComeBack, ()) {
  const Place p = *place();
  const TileFrame frame = frameAt(p, *integer(10, 29));
  const double u = *uniform(0, 1), v = *uniform(0, 1), h = *uniform(-500, 9000);
  const Eigen::Vector3d enu = frame.enuFromTexelExact(u, v, h);
  const Eigen::Vector3d back = frame.texelFromEnu(enu);
  RC_ASSERT((frame.enuFromTexelExact(back.x(), back.y(), back.z()) - enu).norm() < 1e-6);
}

// The largest error over the hardest tiles, so that the stated bound is known to have room: a regular grid
// over zoom 10's biggest tiles, both sides of the antimeridian and the poles.
TEST(TileFrame, WorstErrorOfThePolynomial) {
  double worst_inside = 0, worst_apron = 0;
  std::vector<std::pair<TileLattice, Geodetic>> places;
  for (double lat : {-85.0, -60.0, -20.0, 0.0, 45.0, 85.0})
    places.push_back({TileLattice::webMercator(), {radians(lat), radians(180), 0}});
  for (double lat : {90.0, 84.0}) {
    places.push_back({TileLattice::ups(true), {radians(lat), 1, 0}});
    places.push_back({TileLattice::local({radians(lat), 2, 0}), {radians(lat), 2, 0}});
  }
  places.push_back({TileLattice::utm(60, false).value(), {radians(-45), radians(179), 0}});
  for (const auto& [lattice, at] : places)
    for (int zoom : {10, 14, 20, 28}) {
      const TileFrame frame(lattice, TileLattice::keyAt(*lattice.planeFromGeodetic(at.lat, at.lon), zoom));
      for (int i = -5; i <= 15; ++i)
        for (int j = -5; j <= 15; ++j)
          for (double h : {-500.0, 9000.0}) {
            const double u = 0.1 * i, v = 0.1 * j;
            const double e = (frame.enuFromTexel(u, v, h) - frame.enuFromTexelExact(u, v, h)).norm();
            const bool inside = i >= 0 && j >= 0 && i <= 10 && j <= 10;
            (inside ? worst_inside : worst_apron) = std::max(inside ? worst_inside : worst_apron, e);
          }
    }
  RecordProperty("worst_inside_m", std::to_string(worst_inside));
  std::printf("worst error inside the tile %.3g m, in its apron %.3g m\n", worst_inside, worst_apron);
  EXPECT_LT(worst_inside, 1e-5);
  EXPECT_LT(worst_apron, 1e-4);
}

// At 6,000 m a texel 18 m from the centre moves outwards by 1.7 cm: the effect that the up polynomial is for.
TEST(TileFrame, VerticalsOfATileDiverge) {
  const auto lattice = TileLattice::webMercator();
  const TileFrame frame(lattice, TileLattice::keyAt(*lattice.planeFromGeodetic(0, 0.1), 20));
  const Eigen::Vector3d low = frame.enuFromTexel(0.97, 0.5, 0), high = frame.enuFromTexel(0.97, 0.5, 6000);
  EXPECT_NEAR(low.x(), 18, 0.1);
  EXPECT_NEAR(high.x() - low.x(), 0.017, 0.0005);
}

TEST(TileFrame, EastIsPositiveUAndSouthPositiveV) {
  const auto lattice = TileLattice::webMercator();
  const TileFrame frame(lattice, {18, 137000, 90000});
  EXPECT_GT(frame.enuFromTexel(1, 0.5, 0).x(), 0);
  EXPECT_LT(frame.enuFromTexel(0.5, 1, 0).y(), 0);
  EXPECT_NEAR(frame.enuFromTexel(0.5, 0.5, 12).z(), 12, 1e-6);
}

TEST(TileFrame, NeighboursAgreeOnTheirCommonEdge) {
  for (const auto& lattice : {TileLattice::webMercator(), TileLattice::ups(true)}) {
    const TileKey key = TileLattice::keyAt(*lattice.planeFromGeodetic(radians(84), 0.4), 16);
    const TileFrame west(lattice, key), east(lattice, {key.zoom, key.x + 1, key.y});
    for (double h : {-500.0, 9000.0})
      EXPECT_LT((west.local().ecefFromEnu(west.enuFromTexel(1, 0.3, h)) -
                 east.local().ecefFromEnu(east.enuFromTexel(0, 0.3, h)))
                    .norm(),
                1e-6);
  }
}

}  // namespace
}  // namespace overfly::geo
