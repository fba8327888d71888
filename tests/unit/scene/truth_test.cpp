#include "render/scene/truth.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/unit/scene/scene_fixture.h"

namespace overfly::scene {
namespace {

// Height that the truth gives over a scene place, above the origin.
double heightOver(const Truth& truth, double east, double north) {
  const geo::Geodetic place = geo::geodeticFromEcef(truth.world().local.ecefFromEnu({east, north, 0}));
  return truth.heightAt(place.lat, place.lon).value_or(NAN) - 500;
}

TEST(Truth, FlatGroundIsThePlaneOfTheOrigin) {
  const Truth truth(worldOf("[terrain]\nextent = [200, 200]\n"));
  for (const double east : {-99.0, -3.0, 0.0, 41.7, 99.0}) {
    // The plane touches the ellipsoid at the origin: at distance d it is d^2 / 2R above it.
    EXPECT_NEAR(heightOver(truth, east, 20), (east * east + 400) / (2 * 6.38e6), 2e-5);
  }
  EXPECT_TRUE(std::isnan(heightOver(truth, 101, 0)));
}

TEST(Truth, HousesHaveEavesAndARidge) {
  const Truth truth(
      worldOf("[[building]]\nkind = \"gable\"\nat = [10, 5]\nsize = [12, 8]\nheight = 6\nridge = 3\n"));
  EXPECT_NEAR(heightOver(truth, 10, 5), 9, 1e-4);
  EXPECT_NEAR(heightOver(truth, 10, 7), 7.5, 1e-4);
  EXPECT_NEAR(heightOver(truth, 13, 8.99), 6 + 3 * 0.01 / 4, 1e-3);
  EXPECT_NEAR(heightOver(truth, 10, 9.3), 6 - 3 * 0.3 / 4, 1e-3);  // the overhang
  EXPECT_NEAR(heightOver(truth, 10, 9.5), 0, 1e-4);
}

TEST(Truth, RampRisesAsSaid) {
  const Truth truth(worldOf("[terrain]\nkind = \"ramp\"\nslope = [0.1, -0.2]\nextent = [100, 100]\n"));
  EXPECT_NEAR(heightOver(truth, 20, 10), 0.1 * 20 - 0.2 * 10, 2e-3);
}

TEST(Truth, CanyonHasVerticalWalls) {
  const Truth truth(worldOf(
      "[terrain]\nextent = [300, 300]\n[canyon]\ndepth = 150\nwidth = 80\nwinding = 0\nroughness = 0\n"));
  EXPECT_NEAR(heightOver(truth, 0, 39.9), 0, 1e-3);
  EXPECT_GT(heightOver(truth, 0, 40.1), 149);
}

TEST(Truth, NoPlotIsLaidWhereTheSceneHasBuilt) {
  const Truth truth(
      worldOf("[terrain]\nextent = [240, 140]\n[[street]]\npoints = [[-110, 0], [110, 0]]\nhouses = true\n"
              "[[building]]\nat = [0, 22]\nsize = [40, 30]\nheight = 0.5\n"));
  for (double east = -19; east < 20; east += 2)
    for (double north = 8; north < 36; north += 2) EXPECT_NEAR(heightOver(truth, east, north), 0.5, 1e-3);
  double highest = 0;
  for (double east = -80; east < 80; east += 2) highest = std::max(highest, heightOver(truth, east, -15));
  EXPECT_GT(highest, 5) << "the other side of the street has houses";
}

// A container no higher than the quay is not seen: what a shipped scene places by hand is the top at its
// place (give or take the slope under it: a house stands on its highest ground).
TEST(Truth, WhatShippedScenesPlaceIsSeen) {
  for (const char* name : {"harbour", "village"}) {
    const auto scene = loadScene(OVERFLY_SOURCE_DIR "/tests/data/scenes/" + std::string(name) + ".toml");
    ASSERT_TRUE(scene.has_value());
    const auto world = buildWorld(*scene);
    ASSERT_TRUE(world.has_value());
    const Truth truth(*world);
    for (const BuildingDescription& b : scene->buildings) {
      if (b.kind == BuildingDescription::Kind::Prism) continue;
      for (int i = 0; i < b.repeat[0]; ++i) {
        const Eigen::Vector2d p = b.at + Eigen::Rotation2Dd(b.turn) * Eigen::Vector2d(i * b.step.x(), 0);
        const geo::Geodetic place = geo::geodeticFromEcef((*world)->local.ecefFromEnu({p.x(), p.y(), 0}));
        const double top = truth.heightAt(place.lat, place.lon).value_or(NAN) - scene->place.height_m;
        const double own = (*world)->terrain.heightAt(p.x(), p.y()) + b.height +
                           (b.kind == BuildingDescription::Kind::Gable ? b.ridge : 0);
        EXPECT_NEAR(top, own, 1.2) << name << " at " << p.transpose();
      }
    }
  }
}

TEST(Truth, PlantsStandOnIt) {
  const Truth truth(
      worldOf("[[vegetation]]\nper_hectare = 200\nheight = [8, 8]\n[terrain]\nextent = [100, 100]\n"));
  ASSERT_GT(truth.world().plants.size(), 100u);
  double highest = 0;
  int covered = 0, count = 0;
  for (double north = -45; north < 45; north += 1.3) {
    for (double east = -45; east < 45; east += 1.3) {
      const double height = heightOver(truth, east, north);
      highest = std::max(highest, height);
      covered += height > 1 ? 1 : 0;
      ++count;
    }
  }
  EXPECT_GT(highest, 6.5);
  EXPECT_LT(highest, 10.1);
  EXPECT_GT(covered, count / 10);
  EXPECT_LT(covered, count * 9 / 10);
}

TEST(Truth, TilesAreSampledAtTexelCentresNorthUp) {
  const Truth truth(
      worldOf("[[building]]\nat = [0, 0]\nsize = [10, 10]\nheight = 7\n[terrain]\nextent = [120, 120]\n"));
  const geo::TileLattice lattice = geo::TileLattice::webMercator();
  const auto plane = lattice.planeFromGeodetic(geo::radians(47), geo::radians(9));
  ASSERT_TRUE(plane);
  const geo::TileKey key = geo::TileLattice::keyAt(*plane, 20);
  const TruthTile tile = truth.tile(lattice, key, 64);
  ASSERT_EQ(tile.elevation.size(), 64u * 64u);
  ASSERT_EQ(tile.color.size(), 4u * 64u * 64u);
  int high = 0;
  for (int v = 0; v < 64; v += 7) {
    for (int u = 0; u < 64; u += 7) {
      const geo::Geodetic place =
          lattice.geodeticFromPlane(geo::TileLattice::planeOf(key, (u + 0.5) / 64, (v + 0.5) / 64));
      const float height = tile.elevation[static_cast<std::size_t>(64 * v + u)];
      EXPECT_NEAR(height, *truth.heightAt(place.lat, place.lon), 1e-4);
      high += height > 506 ? 1 : 0;
    }
  }
  EXPECT_GT(high, 0);
}

TEST(Truth, ColourIsFilteredOverTheFootprint) {
  const Truth truth(worldOf("base = \"gravel\"\n[terrain]\nextent = [100, 100]\n"));
  const auto variance = [&](double footprint) {
    double sum = 0, squares = 0;
    for (int i = 0; i < 400; ++i) {
      const geo::Geodetic place =
          geo::geodeticFromEcef(truth.world().local.ecefFromEnu({0.31 * (i % 20), 0.29 * (i / 20), 0}));
      const double value = truth.pointAt(place.lat, place.lon, footprint)->colour[1];
      sum += value / 400;
      squares += value * value / 400;
    }
    return squares - sum * sum;
  };
  EXPECT_GT(variance(0.02), 1.3 * variance(0.2));
  EXPECT_GT(variance(0.2), 1.3 * variance(1.0));
}

}  // namespace
}  // namespace overfly::scene
