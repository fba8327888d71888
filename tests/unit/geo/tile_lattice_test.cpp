#include "capture/geo/tile_lattice.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include "tests/unit/geo/globe.h"

namespace overfly::geo {
namespace {

using testing::integer;
using testing::metresBetween;
using testing::place;
using testing::Place;
using testing::uniform;

RC_GTEST_PROP(TileLatticeProperty, geodeticToTileAndBackWithinAMicrometre, ()) {
  const Place p = *place();
  const int zoom = *integer(0, 29);
  const double near_px = *rc::gen::element(0.5, 0.0, 1.0, -3.25);
  const auto plane = p.lattice.planeFromGeodetic(p.lat, p.lon, near_px);
  RC_ASSERT(plane.has_value());
  // Through the tile's own coordinates: key and fraction, as the sweep and the store use them.
  const TileKey key = TileLattice::keyAt(*plane, zoom);
  const double fx = std::ldexp(plane->x(), zoom) - static_cast<double>(key.x);
  const double fy = std::ldexp(plane->y(), zoom) - static_cast<double>(key.y);
  RC_ASSERT(fx >= 0 && fx < 1 && fy >= 0 && fy < 1);
  const Geodetic back = p.lattice.geodeticFromPlane(TileLattice::planeOf(key, fx, fy));
  RC_ASSERT(std::abs(back.lon) <= 3.14159265358979324);
  RC_ASSERT(metresBetween(p.lat, p.lon, back.lat, back.lon) < 1e-6);
}

RC_GTEST_PROP(TileLatticeProperty, parentAndChildrenCoverTheSameGround, ()) {
  const TileKey key{*integer(0, 28), *integer<std::int64_t>(-1 << 28, 1 << 28),
                    *integer<std::int64_t>(-1 << 28, 1 << 28)};
  for (int i = 0; i < 4; ++i) {
    const TileKey child = childOf(key, i);
    RC_ASSERT(parentOf(child) == key);
    RC_ASSERT(TileLattice::planeOf(child) == TileLattice::planeOf(key, 0.5 * (i & 1), 0.5 * (i >> 1)));
  }
}

// (3.1) at two levels against (3.5): the parent of the cell that holds a point is the coarser cell that
// holds it, on both sides of the origin.
RC_GTEST_PROP(TileLatticeProperty, floorIndicesAgreeBetweenLevelsForEverySign, ()) {
  const Eigen::Vector2d plane(*uniform(-2, 2), *uniform(-2, 2));
  const int zoom = *integer(1, 29);
  const TileKey key = TileLattice::keyAt(plane, zoom);
  RC_ASSERT(parentOf(key) == TileLattice::keyAt(plane, zoom - 1));
  const Eigen::Vector2d corner = TileLattice::planeOf(key), opposite = TileLattice::planeOf(key, 1, 1);
  RC_ASSERT((plane.array() >= corner.array()).all() && (plane.array() < opposite.array()).all());
}

TEST(TileLattice, NegativeIndicesGroupByFloorNotByTruncation) {
  EXPECT_EQ(TileLattice::keyAt({-1e-9, -0.3}, 0), (TileKey{0, -1, -1}));
  EXPECT_EQ(parentOf({5, -1, -2}), (TileKey{4, -1, -1}));
  EXPECT_EQ(parentOf({5, -3, 3}), (TileKey{4, -2, 1}));
}

TEST(TileLattice, WebMercatorKeysAreXyzTiles) {
  const auto lattice = TileLattice::webMercator();
  // Greenwich observatory at zoom 15 (tile.openstreetmap.org/15/16383/10900.png).
  const auto plane = lattice.planeFromGeodetic(radians(51.4779), radians(-0.0015));
  EXPECT_EQ(TileLattice::keyAt(*plane, 15), (TileKey{15, 16383, 10900}));
  EXPECT_NEAR(degrees(lattice.geodeticFromPlane({0.5, 0}).lat), 85.0511287798066, 1e-12);
  EXPECT_FALSE(lattice.planeFromGeodetic(radians(85.06), 0));
  EXPECT_FALSE(lattice.planeFromGeodetic(radians(90), 0));
  EXPECT_FALSE(lattice.planeFromGeodetic(std::nan(""), 0));
}

TEST(TileLattice, AFlightAcrossTheAntimeridianHasOneRange) {
  const auto lattice = TileLattice::webMercator();
  const auto east = lattice.planeFromGeodetic(0.3, radians(179.9999), 0.5);
  const auto west = lattice.planeFromGeodetic(0.3, radians(-179.9999), east->x());
  EXPECT_NEAR(west->x() - east->x(), 0.0002 / 360, 1e-15);
  const TileKey beyond = TileLattice::keyAt(*west, 4);
  EXPECT_EQ(beyond.x, 16);
  EXPECT_EQ(lattice.wrapped(beyond).x, 0);
  EXPECT_EQ(lattice.wrapped({4, -1, 3}), (TileKey{4, 15, 3}));
  EXPECT_EQ(TileLattice::ups(true).wrapped({4, -1, 3}), (TileKey{4, -1, 3}));
}

TEST(TileLattice, OtherProjectionsRefuseWhatIsFarOutside) {
  EXPECT_FALSE(TileLattice::utm(32, true)->planeFromGeodetic(0.1, radians(9 + 60)));
  EXPECT_FALSE(TileLattice::utm(32, true)->planeFromGeodetic(0.1, radians(9 + 179)));
  EXPECT_FALSE(TileLattice::ups(true).planeFromGeodetic(radians(59), 0));
  EXPECT_FALSE(TileLattice::ups(false).planeFromGeodetic(radians(85), 0));
  EXPECT_FALSE(TileLattice::local({0.8, 0.2, 0}).planeFromGeodetic(0.3, 0.2));
}

// The planes' axes: px grows east, py south, at the origin of every lattice.
TEST(TileLattice, AxesPointEastAndSouth) {
  for (const auto& lattice : {TileLattice::webMercator(), TileLattice::utm(32, true).value(),
                              TileLattice::local({radians(48), radians(9), 0})}) {
    const auto at = lattice.planeFromGeodetic(radians(48), radians(9));
    EXPECT_GT(lattice.planeFromGeodetic(radians(48), radians(9.001))->x(), at->x());
    EXPECT_LT(lattice.planeFromGeodetic(radians(48.001), radians(9))->y(), at->y());
  }
}

TEST(TileLattice, TextReadsBackAsTheSameLattice) {
  for (const auto& lattice : {TileLattice::webMercator(), TileLattice::utm(7, false).value(),
                              TileLattice::ups(false), TileLattice::local({0.7123456789, -2.1, 40})}) {
    const auto again = TileLattice::parse(lattice.text());
    ASSERT_TRUE(again.has_value()) << lattice.text();
    EXPECT_EQ(*again, lattice) << lattice.text();
  }
  for (const char* bad : {"", "utm:0N", "utm:61S", "utm:3", "utm:3.5N", "utm:N", "local:91,0", "local:1",
                          "local:1,181", "local:nan,0", "ups:X", "local:1,2x", "utm:1e300N"})
    EXPECT_FALSE(TileLattice::parse(bad)) << bad;
}

// The stated ground length of a plane unit against the lattice's own inverse, by finite differences.
RC_GTEST_PROP(TileLatticeProperty, texelSizeIsTheGroundLength, ()) {
  const Place p = *place();
  const auto plane = p.lattice.planeFromGeodetic(p.lat, p.lon);
  RC_ASSERT(plane.has_value());
  const double d = 1e-7;  // 4 m
  const auto ground = [&](double dx, double dy) {
    return ecefFromGeodetic(p.lattice.geodeticFromPlane(*plane + Eigen::Vector2d(dx, dy)));
  };
  const double east = (ground(d, 0) - ground(-d, 0)).norm() / (2 * d);
  const double south = (ground(0, d) - ground(0, -d)).norm() / (2 * d);
  const double stated = p.lattice.metresPerPlaneUnit(p.lat, p.lon);
  RC_ASSERT(std::abs(stated / (0.5 * (east + south)) - 1) < 1e-6);
  const int zoom = *integer(12, 25);
  const double texel = p.lattice.texelSize(zoom, p.lat, p.lon, 256);
  RC_ASSERT(p.lattice.zoomForGsd(texel * 1.4, p.lat, p.lon, 256) == zoom);
  RC_ASSERT(p.lattice.zoomForGsd(texel / 1.4, p.lat, p.lon, 256) == zoom);
}

}  // namespace
}  // namespace overfly::geo
