#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "daemon/link/detail/coverage.h"

namespace overfly::link {
namespace {

const geo::TileLattice kLattice = geo::TileLattice::webMercator();

Quad square(double west, double north, double side) {
  return {Eigen::Vector2d{west, north}, Eigen::Vector2d{west + side, north},
          Eigen::Vector2d{west + side, north + side}, Eigen::Vector2d{west, north + side}};
}

TEST(ViewsTest, OverlapsAreCountedOnce) {
  const std::vector<Quad> quads{square(0.1, 0.1, 0.4), square(0.3, 0.1, 0.4)};
  const auto grid = countViews({0, 0, 1, 1}, 100, 100, quads);
  EXPECT_EQ(grid.views[grid.index(5, 20)], 0);
  EXPECT_EQ(grid.views[grid.index(20, 20)], 1);
  EXPECT_EQ(grid.views[grid.index(40, 20)], 2);
  EXPECT_EQ(grid.views[grid.index(60, 20)], 1);
  std::size_t seen = 0;
  for (const auto v : grid.views) seen += v;
  EXPECT_EQ(seen, 2u * 40 * 40);
}

TEST(OutlineTest, HolesBelongToTheRingAroundThem) {
  // 5 x 5 with a hole in the middle, and one lone cell that touches at a corner only
  std::vector<bool> set(7 * 7, false);
  for (int y = 0; y < 5; ++y)
    for (int x = 0; x < 5; ++x) set[static_cast<std::size_t>(y * 7 + x)] = x != 2 || y != 2;
  set[5 * 7 + 5] = true;
  const auto found = outlines(set, 7, 7);
  ASSERT_EQ(found.size(), 2u);
  const auto& big = found[0].holes.empty() ? found[1] : found[0];
  const auto& small = found[0].holes.empty() ? found[0] : found[1];
  EXPECT_EQ(big.outer.size(), 4u);
  ASSERT_EQ(big.holes.size(), 1u);
  EXPECT_EQ(big.holes[0].size(), 4u);
  EXPECT_EQ(small.outer.size(), 4u);
  EXPECT_TRUE(small.holes.empty());
}

TEST(PlanTest, HalfFlownPlanIsHalfCoveredAndTheGapIsTheOtherHalf) {
  // about 1 km at the equator
  const std::string plan =
      R"({"type":"Feature","geometry":{"type":"Polygon","coordinates":[[[0,0],[0.01,0],[0.01,0.01],[0,0.01],[0,0]]]}})";
  const auto area = parsePlan(plan, kLattice);
  ASSERT_TRUE(area) << area.error().message;
  const double d = 0.01 / 360;
  const std::vector<Quad> quads(3, square(0.5, 0.5 - d, d / 2));  // the western half, north part of it ...
  std::vector<Quad> both = quads;
  for (int i = 0; i < 3; ++i) both.push_back(square(0.5, 0.5 - d / 2, d / 2));
  const auto report = reportCoverage(&*area, both, 3, kLattice);
  EXPECT_NEAR(report.covered, 0.5, 0.01);
  EXPECT_NEAR(report.area_m2, 1113.2 * 1113.2, 0.02 * 1113.2 * 1113.2);
  const auto gaps = nlohmann::json::parse(report.gaps_geojson);
  ASSERT_EQ(gaps["features"].size(), 1u);
  for (const auto& point : gaps["features"][0]["geometry"]["coordinates"][0])
    EXPECT_GT(point[0].get<double>(), 0.0049);
}

TEST(PlanTest, RubbishIsRefusedWithAReason) {
  for (const auto* bad : {"", "{", "[]", "{}", R"({"type":"Point","coordinates":[1,2]})",
                          R"({"type":"Polygon","coordinates":[[[0,0],[1,1]]]})",
                          R"({"type":"Polygon","coordinates":[[[0,0],[1,"a"],[2,2],[0,0]]]})",
                          R"({"type":"Polygon","coordinates":[[[0,0],[1,1e9],[2,2],[0,0]]]})"}) {
    const auto area = parsePlan(bad, kLattice);
    EXPECT_FALSE(area) << bad;
  }
  EXPECT_FALSE(parsePlan(std::string(100000, '['), kLattice));
}

}  // namespace
}  // namespace overfly::link
