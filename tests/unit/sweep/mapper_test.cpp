// The mapper as a whole on analytic scenes: which frames win, and that a map is a function of its frames.
#include "tiling/mapping/mapper.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <random>

#include "config/settings.h"
#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/sweep/mapper_scene.h"
#include "tiling/mapping/mapper_settings.h"

namespace overfly::tiling {
namespace {

using test::add;
using test::finish;
using test::frameOf;
using test::kGround;
using test::kTile;
using test::kZoom;
using test::photograph;

test::Scene bareGround() {
  return {[](double east, double north) { return kGround + 0.05 * east - 0.03 * north; },
          {},
          test::Pattern(5, 0.5)};
}

class MapperTest : public test::GlTest {
 protected:
  static std::unique_ptr<Mapper> mapper(const MapperOptions& options = {}) {
    return test::sceneMapper(context(), options);
  }
  static geo::TileKey cell() { return test::sceneFrame().key(); }
  // Largest height above the ground, and share of texels in magenta, where the vehicle stood.
  struct Trace {
    double above_m = 0, walls = 0;
  };
  static Trace traceOf(const Tile& tile, const test::Scene& scene, const test::Box& box) {
    Trace trace;
    std::vector<double> above;
    int texels = 0, magenta = 0;
    for (int y = 0; y < kTile; ++y)
      for (int x = 0; x < kTile; ++x) {
        const Eigen::Vector2d p =
            test::sceneFrame().enuFromTexelExact((x + 0.5) / kTile, (y + 0.5) / kTile, kGround).head<2>();
        const auto at = static_cast<std::size_t>(y * kTile + x);
        if (p.x() < box.west - 1.5 || p.x() > box.east + 1.5 || p.y() < box.south - 1.5 ||
            p.y() > box.north + 1.5)
          continue;
        ++texels;
        magenta += std::min(tile.color[4 * at], tile.color[4 * at + 2]) - tile.color[4 * at + 1] > 40 ? 1 : 0;
        if (p.x() > box.west && p.x() < box.east && p.y() > box.south && p.y() < box.north &&
            !std::isnan(tile.elevation[at]))
          above.push_back(static_cast<double>(tile.elevation[at]) - scene.ground(p.x(), p.y()));
      }
    if (!above.empty()) {
      std::nth_element(above.begin(), above.begin() + static_cast<std::ptrdiff_t>(above.size() / 2),
                       above.end());
      trace.above_m = above[above.size() / 2];
    }
    trace.walls = static_cast<double>(magenta) / texels;
    return trace;
  }
};

TEST_F(MapperTest, AVehicleThatDroveAwayDisappearsWhenTheLatestFramesArePreferred) {
  test::Scene with_vehicle = bareGround();
  with_vehicle.box = test::Box{-3.1, -2.2, 2.9, 1.1, kGround + 3};
  const test::Scene without = bareGround();
  // It stands while the first twelve are taken, and has left before the other twelve: it is seen from more
  // places than its place without it.
  const std::vector<test::Photo> early = photograph(with_vehicle, 0.3), late = photograph(without, 2.1);
  const auto map = [&](const RecencyOptions& recency) {
    MapperOptions options;
    options.recency = recency;
    auto made = mapper(options);
    for (std::uint64_t i = 0; i < 12; ++i) add(*made, frameOf(i, early[i], static_cast<double>(i)));
    for (std::uint64_t i = 0; i < 8; ++i) add(*made, frameOf(20 + i, late[i], 100 + static_cast<double>(i)));
    return traceOf(finish(*made), without, *with_vehicle.box);
  };
  auto only_early = mapper();
  for (std::uint64_t i = 0; i < 12; ++i) add(*only_early, frameOf(i, early[i], static_cast<double>(i)));
  const Trace stood = traceOf(finish(*only_early), without, *with_vehicle.box);
  EXPECT_GT(stood.above_m, 2.5);

  const Trace latest = map({.prefer = Prefer::Latest});
  EXPECT_LT(std::abs(latest.above_m), 0.3);
  EXPECT_EQ(latest.walls, 0);
  const Trace young = map({.prefer = Prefer::MaxAge, .max_age_s = 30});
  EXPECT_LT(std::abs(young.above_m), 0.3);
  EXPECT_EQ(young.walls, 0);
  // Old enough for all: the same as without a preference.
  const Trace all = map({.prefer = Prefer::MaxAge, .max_age_s = 1000}), best = map({});
  EXPECT_EQ(all.above_m, best.above_m);
  EXPECT_EQ(all.walls, best.walls);
}

TEST_F(MapperTest, TheOrderInWhichFramesCameDoesNotMatter) {
  test::Scene scene = bareGround();
  scene.box = test::Box{-4, -3, 3, 2, kGround + 4};
  std::vector<capture::FramePtr> frames;
  for (const test::Photo& photo : photograph(scene, 0.7)) {
    test::Photo dimmed = photo;  // so that exposure gains are not all 1
    for (std::uint8_t& value : dimmed.rgba)
      value = static_cast<std::uint8_t>(value * (1 - 0.02 * static_cast<double>(frames.size())));
    frames.push_back(frameOf(frames.size(), dimmed, static_cast<double>(frames.size())));
  }
  auto at_once = mapper();
  for (const auto& frame : frames) add(*at_once, frame);
  static_cast<void>(at_once->balanceExposure());
  const Tile reference = finish(*at_once);
  EXPECT_FALSE(reference.empty());

  std::mt19937 random(3);
  for (int round = 0; round < 3; ++round) {
    std::shuffle(frames.begin(), frames.end(), random);
    auto made = mapper();
    std::size_t count = 0;
    for (const auto& frame : frames) {
      add(*made, frame);
      // In the making it is shown now and then, as in flight.
      if (++count % 5 != 0) continue;
      static_cast<void>(made->balanceExposure());
      ASSERT_TRUE(made->sweepCell(cell()).has_value());
      static_cast<void>(finish(*made, Mapper::Around::AsSwept));
    }
    static_cast<void>(made->balanceExposure());
    for (const geo::TileKey& key : Mapper::neighboursOf(cell()))
      ASSERT_TRUE(made->sweepCell(key).has_value());
    EXPECT_TRUE(finish(*made, Mapper::Around::AsSwept) == reference) << "round " << round;
  }
}

TEST_F(MapperTest, AsSweptSweepsNoNeighbour) {
  auto made = mapper();
  for (std::uint64_t i = 0; const test::Photo& photo : photograph(bareGround(), 0))
    add(*made, frameOf(i, photo, 0)), ++i;
  ASSERT_TRUE(made->sweepCell(cell()).has_value());
  EXPECT_EQ(made->statistics().cells_swept, 1u);
  static_cast<void>(finish(*made, Mapper::Around::AsSwept));
  EXPECT_EQ(made->statistics().cells_swept, 1u);
  static_cast<void>(finish(*made));
  EXPECT_GT(made->statistics().cells_swept, 1u);
}

TEST_F(MapperTest, WorkingScaleMakesTheSweepsTexelsCoarser) {
  for (const auto& [share, zoom] : {std::pair{1.0, kZoom}, {0.5, kZoom - 1}, {0.2, kZoom - 3}}) {
    MapperOptions options;
    options.working_scale = share;
    EXPECT_EQ(mapper(options)->cellZoom(), zoom) << share;
  }
}

TEST(MapperSettings, DefaultsAreTheMappersOwn) {
  const MapperOptions from = mapperOptions({}), own;
  EXPECT_EQ(from.sweep.cost, own.sweep.cost);
  EXPECT_EQ(from.sweep.max_views, own.sweep.max_views);
  EXPECT_EQ(from.sweep.window_radius, own.sweep.window_radius);
  EXPECT_EQ(from.sweep.levels, own.sweep.levels);
  EXPECT_EQ(from.sweep.max_planes, own.sweep.max_planes);
  EXPECT_EQ(from.sweep.better_half, own.sweep.better_half);
  EXPECT_EQ(from.sweep.regularise, own.sweep.regularise);
  EXPECT_EQ(from.sweep.min_score, own.sweep.min_score);
  EXPECT_EQ(from.views.parallax_low, own.views.parallax_low);
  EXPECT_EQ(from.views.parallax_high, own.views.parallax_high);
  EXPECT_EQ(from.views.parallax_best_from, own.views.parallax_best_from);
  EXPECT_EQ(from.views.parallax_best_to, own.views.parallax_best_to);
  EXPECT_EQ(from.recency.prefer, own.recency.prefer);
  EXPECT_EQ(from.working_scale, own.working_scale);
  EXPECT_EQ(from.hole_texels, own.hole_texels);
  EXPECT_EQ(from.tile_size, own.tile_size);
}

TEST(MapperSettings, EverySettingArrives) {
  config::Settings settings;
  config::Sweep& sweep = settings.sweep;
  sweep.images = 5;
  sweep.window = 9;
  sweep.cost = config::MatchingCost::Census;
  sweep.better_half = true;
  sweep.planes = 99;
  sweep.levels = 2;
  sweep.regularise = 0.25;
  sweep.working_scale = 0.5;
  sweep.min_confidence = 0.4;
  sweep.min_parallax_deg = 10;
  sweep.max_parallax_deg = 20;
  sweep.search_above_m = 31;
  sweep.search_below_m = 7;
  sweep.prefer = config::Prefer::MaxAge;
  sweep.max_age_s = 12;
  sweep.fill = false;
  sweep.fallback = config::Fallback::LowestCost;
  settings.map.gsd_m = 0.3;
  const MapperOptions options = mapperOptions(settings), own;
  EXPECT_EQ(options.sweep.max_views, 5);
  EXPECT_EQ(options.sweep.window_radius, 4);
  EXPECT_EQ(options.sweep.cost, MatchCost::Census);
  EXPECT_TRUE(options.sweep.better_half);
  EXPECT_EQ(options.sweep.max_planes, 99);
  EXPECT_EQ(options.sweep.levels, 2);
  EXPECT_TRUE(options.sweep.regularise);
  EXPECT_NEAR(options.sweep.path_penalty_jump, own.sweep.path_penalty_jump / 2, 1e-12);
  EXPECT_EQ(options.working_scale, 0.5);
  EXPECT_EQ(options.sweep.min_score, 0.4);
  EXPECT_NEAR(options.views.parallax_low, geo::radians(10), 1e-12);
  EXPECT_NEAR(options.views.parallax_high, geo::radians(20), 1e-12);
  EXPECT_LE(options.views.parallax_best_to, options.views.parallax_high);
  EXPECT_GE(options.views.parallax_best_from, options.views.parallax_low);
  EXPECT_EQ(options.recency.prefer, Prefer::MaxAge);
  EXPECT_EQ(options.recency.max_age_s, 12);
  EXPECT_EQ(options.hole_texels, 0);
  EXPECT_EQ(options.fallback, Fallback::LowestCost);
  const GroundOptions ground = groundOptions(settings);
  EXPECT_EQ(ground.gsd_m, 0.3);
  EXPECT_EQ(ground.search_above_m, 31);
  EXPECT_EQ(ground.search_below_m, 7);
}

}  // namespace
}  // namespace overfly::tiling
