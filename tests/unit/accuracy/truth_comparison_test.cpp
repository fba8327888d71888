#include "tiling/accuracy/truth_comparison.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "render/scene/flight_path.h"
#include "render/scene/renderer.h"

namespace overfly::tiling {
namespace {

constexpr int kZoom = 19, kSize = 64;

// Flat ground with one box, seen by a short flight; a map that is the truth itself, to be spoilt by the
// tests.
struct Fixture {
  std::shared_ptr<const scene::World> world;
  std::unique_ptr<scene::Truth> truth;
  scene::FlightPlan plan;
  MapPlace place;
  std::map<geo::TileKey, Tile> tiles;

  explicit Fixture(const std::string& effects = "") {
    auto scene = scene::parseScene(
        "effects = [" + effects +
            "]\n[place]\nlat_deg = 47\nlon_deg = 9\nheight_m = 500\n[terrain]\nextent = [140, 140]\n"
            "[[building]]\nat = [5, 5]\nsize = [14, 10]\nheight = 8\n[sun]\nazimuth_deg = 150\nelevation_deg "
            "= 35\n"
            "[camera]\nwidth = 320\nheight = 240\nfx = 240\n[path]\nheight = 60\nframes = 9\nlines = 3\n",
        "test.toml");
    EXPECT_TRUE(scene) << scene.error().message;
    world = *scene::buildWorld(*scene);
    truth = std::make_unique<scene::Truth>(world);
    plan = scene::planFlight(*world, scene::FlightPath(scene->path, scene->camera, scene->seed));
    place.zoom = kZoom;
    place.gsd_m = 0.25;
    place.texel_m = place.lattice.texelSize(kZoom, geo::radians(47), geo::radians(9), kSize);
    const auto middle = *place.lattice.planeFromGeodetic(geo::radians(47), geo::radians(9));
    const geo::TileKey centre = geo::TileLattice::keyAt(middle, kZoom);
    for (std::int64_t dy = -1; dy <= 1; ++dy)
      for (std::int64_t dx = -1; dx <= 1; ++dx) {
        const geo::TileKey key{kZoom, centre.x + dx, centre.y + dy};
        const scene::TruthTile exact = truth->tile(place.lattice, key, kSize);
        Tile tile = Tile::blank(key, kSize);
        tile.elevation = exact.elevation;
        tile.color = exact.color;
        for (std::size_t i = 0; i < tile.texels(); ++i)
          tile.kind[i] = std::isnan(tile.elevation[i]) ? kNoData : kMeasured;
        tiles.emplace(key, std::move(tile));
      }
  }
  [[nodiscard]] TruthComparison compare(int min_frames = 3) const {
    return compareWithTruth(tiles, place, *truth, plan, scene::effectiveCamera(world->description),
                            {1, min_frames});
  }
};

TEST(TruthComparison, TheTruthItselfHasNoError) {
  const TruthComparison c = Fixture().compare();
  EXPECT_GT(c.all.points, 5000u);
  EXPECT_EQ(c.all.measured, c.all.points);
  EXPECT_NEAR(c.all.rmse, 0, 1e-3) << "float32 metres in 0.25 m";
  EXPECT_GT(c.solids.points, 50u);
  EXPECT_EQ(c.ground.points + c.solids.points, c.all.points);
  EXPECT_EQ(c.plants.points, 0u);
  EXPECT_GT(c.colour.texels, c.all.points) << "one frame is enough for colour";
  EXPECT_EQ(c.colour.p95, 0);
}

// Behind the box, 8 m high, lies ground that the frames of one line have in their pictures and do not see.
TEST(TruthComparison, HiddenPlacesAreToldFromSeenOnes) {
  Fixture map;
  EXPECT_EQ(map.compare().hidden.points, 0u) << "all nine frames see round the box";
  map.plan.frames.resize(3);
  const TruthComparison c = map.compare(2);
  EXPECT_EQ(c.seen.points + c.hidden.points, c.all.points);
  EXPECT_GT(c.hidden.points, 3u);
  EXPECT_LT(c.hidden.points, c.all.points / 20);
  map.plan.frames.resize(1);
  EXPECT_EQ(map.compare(1).seen.points, 0u) << "one frame tells no height";
}

TEST(TruthComparison, ErrorsAreMapMinusTruthInGsd) {
  Fixture map;
  for (auto& [key, tile] : map.tiles)
    for (float& h : tile.elevation) h += 0.1f;
  const TruthComparison c = map.compare();
  EXPECT_NEAR(c.all.median, 0.4, 1e-3);
  EXPECT_NEAR(c.all.nmad, 0, 1e-3);
  EXPECT_NEAR(c.ground.rmse, 0.4, 1e-3);
}

TEST(TruthComparison, FilledAndMissingHeightsAreIncomplete) {
  Fixture map;
  for (auto& [key, tile] : map.tiles) std::fill(tile.kind.begin(), tile.kind.end(), kFilled);
  EXPECT_EQ(map.compare().all.complete, 0);
  Fixture holed;
  const std::size_t before = holed.compare().all.points;
  const auto centre = std::next(holed.tiles.begin(), 4);
  holed.tiles.erase(centre);
  const TruthComparison c = holed.compare();
  EXPECT_EQ(c.all.points, before) << "a tile that is not there is asked for all the same";
  EXPECT_LT(c.all.complete, 0.95);
}

TEST(TruthComparison, MoreFramesAskedForLeaveLessGround) {
  const Fixture map;
  const std::size_t one = map.compare(1).all.points, three = map.compare(3).all.points;
  EXPECT_GT(one, three);
  EXPECT_GT(three, 0u);
}

TEST(TruthComparison, TrueColourHasTheShadowsThatTheSceneNames) {
  const Fixture lit;
  EXPECT_EQ(lit.compare().colour.beyond_32, 0);
  Fixture wrong("\"sun_shadows\"");
  wrong.tiles = lit.tiles;  // a map without shadows of a scene with them
  const TruthComparison c = wrong.compare();
  EXPECT_GT(c.colour.beyond_32, 0.005) << "the box throws a shadow of 11 m";
}

}  // namespace
}  // namespace overfly::tiling
