#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include "tests/unit/sweep/analytic_scene.h"
#include "tiling/accuracy/accuracy.h"
#include "tiling/accuracy/border_steps.h"
#include "tiling/mapping/exposure_balance.h"
#include "tiling/mapping/ground_estimate.h"
#include "tiling/mapping/guess_surface.h"
#include "tiling/mapping/height_mosaic.h"
#include "tiling/mapping/mapper.h"

namespace overfly::tiling {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr int kTexels = 32, kApron = 16, kMargin = 20;

// A field of the cell (column, row) of a larger surface.
template <typename Surface>
HeightField fieldOf(int column, int row, const Surface& surface) {
  HeightField field;
  field.texels = kTexels;
  field.apron = kApron;
  for (int y = -kApron; y < kTexels + kApron; ++y)
    for (int x = -kApron; x < kTexels + kApron; ++x)
      field.height.push_back(surface(column * kTexels + x, row * kTexels + y));
  field.score.assign(field.height.size(), 0.8f);
  field.confidence.assign(field.height.size(), 200);
  return field;
}

template <typename MakeField>
HeightMosaic mosaicAt(int column, int row, const MakeField& make, double step_m) {
  std::vector<HeightField> fields;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) fields.push_back(make(column + dx, row + dy));
  std::array<const HeightField*, 9> pointers{};
  for (std::size_t i = 0; i < 9; ++i) pointers[i] = &fields[i];
  return assembleHeights(pointers, kMargin, step_m);
}

TEST(AssembleHeights, FieldsThatAgreeGiveTheSurfaceWithoutAStep) {
  const auto surface = [](int x, int y) {
    return 400 + 0.03f * static_cast<float>(x) - 0.05f * static_cast<float>(y);
  };
  const HeightMosaic mosaic = mosaicAt(
      0, 0, [&](int c, int r) { return fieldOf(c, r, surface); }, 0.5);
  ASSERT_EQ(mosaic.side(), kTexels + 2 * kMargin);
  for (int y = 0; y < mosaic.side(); ++y)
    for (int x = 0; x < mosaic.side(); ++x)
      ASSERT_NEAR(mosaic.height[static_cast<std::size_t>(y * mosaic.side() + x)],
                  surface(x - kMargin, y - kMargin), 1e-3);
}

TEST(AssembleHeights, SmallDisagreementChangesOverGradually) {
  const auto make = [](int c, int r) {
    return fieldOf(c, r, [&](int, int) { return ((c + r) & 1) != 0 ? 10.1f : 9.9f; });
  };
  const HeightMosaic mosaic = mosaicAt(0, 0, make, 0.5);
  for (int y = 0; y < mosaic.side(); ++y)
    for (int x = 1; x < mosaic.side(); ++x) {
      const auto i = static_cast<std::size_t>(y * mosaic.side() + x);
      ASSERT_LE(std::abs(mosaic.height[i] - mosaic.height[i - 1]), 0.2f / kApron + 1e-3f) << x << ", " << y;
    }
}

TEST(AssembleHeights, AStepStaysAStep) {
  const auto make = [](int c, int r) {
    return fieldOf(c, r, [&](int x, int) { return x < 3 + (c & 1) ? 10.0f : 20.0f; });
  };
  const HeightMosaic mosaic = mosaicAt(0, 0, make, 0.5);
  for (const float h : mosaic.height) ASSERT_TRUE(h == 10.0f || h == 20.0f) << h;
}

TEST(AssembleHeights, TwoCellsSeeTheSameHeightAtTheSamePlace) {
  const auto make = [](int c, int r) {
    std::mt19937 random(static_cast<std::uint32_t>(100 * c + r + 7000));
    std::uniform_real_distribution<float> any(0.0f, 1.0f);
    HeightField field = fieldOf(c, r, [&](int, int) { return any(random) < 0.1f ? kNaN : 10 + any(random); });
    for (std::uint8_t& confidence : field.confidence) confidence = static_cast<std::uint8_t>(random() % 256);
    return field;
  };
  const HeightMosaic west = mosaicAt(0, 0, make, 0.4), east = mosaicAt(1, 0, make, 0.4);
  int compared = 0;
  for (int y = 0; y < west.side(); ++y)
    for (int x = kTexels; x < west.side(); ++x) {
      const float a = west.height[static_cast<std::size_t>(y * west.side() + x)];
      const float b = east.height[static_cast<std::size_t>(y * west.side() + x - kTexels)];
      ASSERT_EQ(std::isnan(a), std::isnan(b)) << x << ", " << y;
      if (std::isnan(a)) continue;
      ASSERT_NEAR(a, b, 1e-4) << x << ", " << y;
      ++compared;
    }
  EXPECT_GT(compared, 1000);
}

// A field of half the resolution, of the same ground: coarse texel i lies over fine texels 2 i and 2 i + 1.
template <typename Surface>
HeightField halvedFieldOf(int column, int row, const Surface& surface) {
  HeightField field;
  field.texels = kTexels / 2;
  field.apron = kApron;
  field.halvings = 1;
  for (int y = -kApron; y < field.texels + kApron; ++y)
    for (int x = -kApron; x < field.texels + kApron; ++x)
      field.height.push_back(surface(column * kTexels + 2 * x + 0.5, row * kTexels + 2 * y + 0.5));
  field.confidence.assign(field.height.size(), 200);
  return field;
}

TEST(AssembleHeights, FieldsOfHalfTheResolutionStaySo) {
  const auto surface = [](double x, double y) { return static_cast<float>(400 + 0.03 * x - 0.05 * y); };
  const HeightMosaic mosaic = mosaicAt(
      0, 0, [&](int c, int r) { return halvedFieldOf(c, r, surface); }, 0.5);
  ASSERT_EQ(mosaic.halvings, 1);
  ASSERT_EQ(mosaic.texels, kTexels / 2);
  ASSERT_EQ(mosaic.margin, kMargin / 2);
  for (int y = 0; y < mosaic.side(); ++y)
    for (int x = 0; x < mosaic.side(); ++x)
      ASSERT_NEAR(mosaic.height[static_cast<std::size_t>(y * mosaic.side() + x)],
                  surface(2 * (x - mosaic.margin) + 0.5, 2 * (y - mosaic.margin) + 0.5), 1e-3);
}

TEST(AssembleHeights, CoarserFieldsBesideFinerOnesAreInterpolated) {
  const auto surface = [](double x, double y) { return static_cast<float>(400 + 0.03 * x - 0.05 * y); };
  const auto make = [&](int c, int r) {
    if (c > 0) return halvedFieldOf(c, r, surface);
    return fieldOf(c, r, [&](int x, int y) { return surface(x, y); });
  };
  const HeightMosaic west = mosaicAt(0, 0, make, 0.5), east = mosaicAt(1, 0, make, 0.5);
  for (const HeightMosaic* mosaic : {&west, &east}) {
    ASSERT_EQ(mosaic->halvings, 0);
    const int first = mosaic == &east ? kTexels : 0;
    for (int y = 0; y < mosaic->side(); ++y)
      for (int x = 0; x < mosaic->side(); ++x)
        ASSERT_NEAR(mosaic->height[static_cast<std::size_t>(y * mosaic->side() + x)],
                    surface(first + x - kMargin, y - kMargin), 1e-3)
            << x << ", " << y;
  }
  // A hole keeps its place and does not reach its neighbours.
  const auto holed = [&](int c, int r) {
    HeightField field = make(c, r);
    if (c == 1 && r == 0) field.height[static_cast<std::size_t>(20 * field.side() + 20)] = kNaN;
    return field;
  };
  const HeightMosaic with_hole = mosaicAt(1, 0, holed, 0.5);
  for (int y = 0; y < kTexels; ++y)
    for (int x = 0; x < kTexels; ++x) {
      const bool hole = x / 2 == 20 - kApron && y / 2 == 20 - kApron;
      const auto at = static_cast<std::size_t>((y + kMargin) * with_hole.side() + x + kMargin);
      ASSERT_EQ(std::isnan(with_hole.height[at]), hole) << x << ", " << y;
      if (hole) continue;
      ASSERT_NEAR(with_hole.height[at], surface(kTexels + x, y), 0.06);
    }
}

TEST(AssembleHeights, MissingNeighboursAreLeftOut) {
  const HeightField field = fieldOf(0, 0, [](int, int) { return 5.0f; });
  std::array<const HeightField*, 9> fields{};
  fields[4] = &field;
  const HeightMosaic mosaic = assembleHeights(fields, kMargin, 0.5);
  const auto side = static_cast<std::size_t>(mosaic.side());
  EXPECT_TRUE(std::isnan(mosaic.height[0]));
  for (std::size_t y = kMargin; y < kMargin + kTexels; ++y)
    for (std::size_t x = kMargin; x < kMargin + kTexels; ++x) ASSERT_EQ(mosaic.height[y * side + x], 5.0f);
}

TEST(GuessSurface, FillsEverythingAndKeepsWhatIsKnown) {
  constexpr int kSide = 37;
  std::vector<float> height(kSide * kSide, kNaN);
  for (std::size_t i = 0; i < height.size(); i += 11) height[i] = 100 + static_cast<float>(i % 5);
  const std::vector<float> guess = guessSurface(height, kSide, 10.0, 3.0);
  for (std::size_t i = 0; i < height.size(); ++i) {
    if (!std::isnan(height[i])) {
      EXPECT_EQ(guess[i], height[i]);
    }
    EXPECT_GE(guess[i], 100.0f);
    EXPECT_LE(guess[i], 104.0f);
  }
  for (const float h : guessSurface(std::vector<float>(kSide * kSide, kNaN), kSide, 10.0, 3.0))
    EXPECT_EQ(h, 3.0f);
}

TEST(GuessSurface, AHoleBesideAWallIsGround) {
  constexpr int kSide = 64;
  std::vector<float> height(kSide * kSide, 100);
  const auto at = [](int x, int y) { return static_cast<std::size_t>(y * kSide + x); };
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      if (x < 21) height[at(x, y)] = 110;  // a roof
      if (x >= 21 && x < 34 && y > 10 && y < 50) height[at(x, y)] = kNaN;
    }
  const std::vector<float> guess = guessSurface(height, kSide, 0.2, 0);
  for (int y = 11; y < 50; ++y)
    for (int x = 21; x < 34; ++x) EXPECT_NEAR(guess[at(x, y)], 100, 0.01) << x << " " << y;
}

TEST(StatisticsOf, GivesTheTextbookFigures) {
  const ErrorStatistics s = statisticsOf({-1, 0, 1}, 4);
  EXPECT_DOUBLE_EQ(s.complete, 0.75);
  EXPECT_DOUBLE_EQ(s.median, 0);
  EXPECT_DOUBLE_EQ(s.nmad, 1.4826);
  EXPECT_NEAR(s.rmse, std::sqrt(2.0 / 3), 1e-12);
  EXPECT_EQ(s.measured, 3u);
  const ErrorStatistics far = statisticsOf({11, -6, 0.5, 5, -10}, 5);
  EXPECT_NEAR(far.beyond_5, 0.6, 1e-12);
  EXPECT_NEAR(far.beyond_10, 0.2, 1e-12);
  EXPECT_DOUBLE_EQ(far.p99, 11);
  const ErrorStatistics none = statisticsOf({}, 7);
  EXPECT_EQ(none.points, 7u);
  EXPECT_EQ(none.complete, 0);
}

TEST(StatisticsOf, NmadOfANormalDistributionIsItsDeviation) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0.7, 2.0);
  std::vector<double> errors;
  for (int i = 0; i < 20000; ++i) errors.push_back(normal(random));
  const ErrorStatistics s = statisticsOf(errors, errors.size());
  EXPECT_NEAR(s.median, 0.7, 0.06);
  EXPECT_NEAR(s.nmad, 2.0, 0.06);
  EXPECT_NEAR(s.rmse, std::sqrt(4 + 0.49), 0.06);
}

TEST(BorderSteps, TellsASeamFromTheGroundsOwnSteps) {
  constexpr int kSize = 16;
  const auto map = [&](float seam_m) {
    std::map<geo::TileKey, Tile> tiles;
    for (std::int64_t x = 0; x < 4; ++x) {
      Tile tile = Tile::blank({20, x, 0}, kSize);
      for (int j = 0; j < kSize; ++j)
        for (int i = 0; i < kSize; ++i) {
          const auto at = static_cast<std::size_t>(j * kSize + i);
          tile.elevation[at] = 0.01f * static_cast<float>(x * kSize + i + j) + (x >= 2 ? seam_m : 0.0f);
          tile.kind[at] = kMeasured;
        }
      tiles.emplace(tile.key, tile);
    }
    return tiles;
  };
  EXPECT_NEAR(borderSteps(map(0)).ratio(), 1, 1e-3);
  const BorderSteps cells = borderSteps(map(0.05f), 2);  // the seam alone is a border of cells
  EXPECT_EQ(cells.borders, static_cast<std::size_t>(kSize));
  EXPECT_NEAR(cells.ratio(), 6, 0.01);
  // What is not measured does not count.
  std::map<geo::TileKey, Tile> tiles = map(0.05f);
  std::fill(tiles.begin()->second.kind.begin(), tiles.begin()->second.kind.end(), kFilled);
  EXPECT_EQ(borderSteps(tiles).borders, static_cast<std::size_t>(2 * kSize));
}

class HeightAt : public ::testing::Test {
 protected:
  static constexpr int kSize = 16, kZoom = 22;
  HeightAt() {
    for (std::int64_t y = -1; y <= 0; ++y)
      for (std::int64_t x = -1; x <= 0; ++x) {
        Tile tile = Tile::blank({kZoom, x, y}, kSize);
        for (int j = 0; j < kSize; ++j)
          for (int i = 0; i < kSize; ++i) {
            const auto at = static_cast<std::size_t>(j * kSize + i);
            tile.elevation[at] = static_cast<float>(
                truth(static_cast<double>(x * kSize + i) + 0.5, static_cast<double>(y * kSize + j) + 0.5));
            tile.kind[at] = kMeasured;
          }
        tiles.emplace(tile.key, tile);
      }
  }
  static double truth(double tx, double ty) { return 50 + 0.25 * tx - 0.5 * ty; }
  // At a place in global texel coordinates around the lattice's origin.
  [[nodiscard]] std::optional<double> at(double tx, double ty, bool filled = false) const {
    const geo::Geodetic place =
        lattice.geodeticFromPlane(Eigen::Vector2d(tx, ty) / kSize / std::ldexp(1.0, kZoom));
    return heightAt(tiles, lattice, kZoom, 0, place, filled);
  }
  geo::TileLattice lattice = geo::TileLattice::local({geo::radians(47), geo::radians(8), 0});
  std::map<geo::TileKey, Tile> tiles;
};

TEST_F(HeightAt, IsBilinearAcrossTileBordersAndNegativeKeys) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> any(-15.4, 15.4);
  for (int i = 0; i < 300; ++i) {
    const double tx = any(random), ty = any(random);
    const auto height = at(tx, ty);
    ASSERT_TRUE(height.has_value()) << tx << ", " << ty;
    ASSERT_NEAR(*height, truth(tx, ty), 1e-4) << tx << ", " << ty;
  }
}

TEST_F(HeightAt, HasNoneBesideAMissingTileOrAnUnmeasuredTexel) {
  EXPECT_FALSE(at(15.8, 0).has_value());
  Tile& tile = tiles.at({kZoom, -1, -1});
  tile.kind[15 * kSize + 15] = kFilled;  // texel (-1, -1)
  EXPECT_FALSE(at(-0.2, -0.2).has_value());
  EXPECT_TRUE(at(-0.2, -0.2, true).has_value());
  tile.elevation[15 * kSize + 15] = kNaN;
  EXPECT_FALSE(at(-0.2, -0.2, true).has_value());
  EXPECT_TRUE(at(-2, -2).has_value());
}

class ReferencePoints : public ::testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove(file); }
  Result<std::vector<ReferencePoint>> read(const std::string& text) const {
    std::ofstream(file) << text;
    return readReferencePoints(file, origin);
  }
  std::filesystem::path file =
      std::filesystem::temp_directory_path() /
      ("overfly_reference_" + std::to_string(::testing::UnitTest::GetInstance()->random_seed()) + "_" +
       ::testing::UnitTest::GetInstance()->current_test_info()->name() + std::to_string(getpid()) + ".csv");
  geo::Geodetic origin{geo::radians(47), geo::radians(8), 400};
};

TEST_F(ReferencePoints, AreReadByTheNamesOfTheirColumns) {
  const auto points = read("track_length,z,y,x\n7,12.5,0,0\n3,0,200,100\n");
  ASSERT_TRUE(points.has_value()) << points.error().message;
  ASSERT_EQ(points->size(), 2u);
  EXPECT_NEAR((*points)[0].place.height_m, 412.5, 1e-6);
  EXPECT_NEAR((*points)[0].place.lat, geo::radians(47), 1e-12);
  EXPECT_EQ((*points)[0].track, 7);
  EXPECT_GT((*points)[1].place.lat, geo::radians(47));
  EXPECT_GT((*points)[1].place.lon, geo::radians(8));
}

TEST_F(ReferencePoints, ErrorsNameTheLine) {
  const auto line = [](const auto& result) { return result ? std::string() : result.error().message; };
  EXPECT_EQ(readReferencePoints("/nowhere/points.csv", origin).error().code, ErrorCode::NotFound);
  EXPECT_NE(line(read("x,y\n1,2\n")).find(":1: no column z"), std::string::npos);
  EXPECT_NE(line(read("x,y,z\n1,2,3\n1,tree,3\n")).find(":3:"), std::string::npos);
  EXPECT_NE(line(read("x,y,z\n1,2\n")).find(":2:"), std::string::npos);
  EXPECT_FALSE(read("").has_value());
}

Thumbnail thumbnailOf(std::uint64_t id, const test::Photo& photo, double gain = 1) {
  Thumbnail thumbnail{id, photo.camera, photo.pose, {}};
  for (const std::uint8_t value : photo.luma)
    thumbnail.luma.push_back(static_cast<std::uint8_t>(std::lround(std::min(255.0, gain * value))));
  return thumbnail;
}

std::vector<test::Photo> strip(const test::Scene& scene, int count) {
  std::vector<test::Photo> photos;
  for (int i = 0; i < count; ++i)
    photos.push_back(test::takePhoto(scene, test::sceneCamera(110, 100),
                                     test::lookDown(9.0 * i - 15, 0.8 * i, test::kGround + test::kFlight)));
  return photos;
}

test::Scene coarseGround() {
  return {[](double, double) { return test::kGround; }, {}, test::Pattern(4, 1.5)};
}

TEST(EstimateGround, FindsThePlaneBelowTheFrames) {
  std::vector<Thumbnail> frames;
  for (const test::Photo& photo : strip(coarseGround(), 4))
    frames.push_back(thumbnailOf(frames.size(), photo, 1 - 0.1 * static_cast<double>(frames.size())));
  const auto ground = estimateGround(frames);
  ASSERT_TRUE(ground.has_value()) << ground.error().message;
  EXPECT_NEAR(ground->height_m, test::kGround, 0.6);  // 0.1 px of parallax at 15 px
  EXPECT_NEAR(ground->camera_above_m, test::kFlight, 0.6);
  EXPECT_GT(ground->correlation, 0.95);
  EXPECT_EQ(ground->pairs, 5);
}

TEST(SettleGround, SearchRangeIsTheSettingsWhereTheySayOne) {
  std::vector<Thumbnail> frames;
  std::vector<capture::CameraModel> cameras;
  for (const test::Photo& photo : strip(coarseGround(), 4)) {
    frames.push_back(thumbnailOf(frames.size(), photo));
    cameras.push_back(photo.camera);
  }
  const geo::TileLattice lattice = geo::TileLattice::webMercator();
  const auto by_flight = Mapper::settleGround(frames, cameras, lattice);
  ASSERT_TRUE(by_flight.has_value()) << by_flight.error().message;
  EXPECT_LT(by_flight->min_height_m, by_flight->height_m - 10);
  EXPECT_GT(by_flight->max_height_m, by_flight->height_m + 30);
  GroundOptions options;
  options.search_above_m = 5;
  options.search_below_m = 3;
  const auto told = Mapper::settleGround(frames, cameras, lattice, options);
  ASSERT_TRUE(told.has_value());
  EXPECT_EQ(told->min_height_m, std::floor(told->height_m - 3));
  EXPECT_EQ(told->max_height_m, std::ceil(told->height_m + 5));
  // Never up to the cameras.
  options = {};
  options.search_above_m = 500;
  const auto tall = Mapper::settleGround(frames, cameras, lattice, options);
  ASSERT_TRUE(tall.has_value());
  EXPECT_LT(tall->max_height_m, test::kGround + test::kFlight);
}

TEST(EstimateGround, SaysSoWhenThereIsNothingToCompare) {
  test::Scene bare = coarseGround();
  std::vector<Thumbnail> grey, still, frozen;
  for (const test::Photo& photo : strip(bare, 3)) {
    grey.push_back(thumbnailOf(grey.size(), photo));
    std::fill(grey.back().luma.begin(), grey.back().luma.end(), std::uint8_t{128});
    still.push_back(thumbnailOf(still.size(), photo));
    still.back().pose = still.front().pose;
    // The camera flies on, and its pictures stay the same.
    frozen.push_back(thumbnailOf(frozen.size(), photo));
    frozen.back().luma = frozen.front().luma;
  }
  for (const auto& frames : {grey, still, frozen, std::vector<Thumbnail>{}}) {
    const auto ground = estimateGround(frames);
    ASSERT_FALSE(ground.has_value());
    EXPECT_EQ(ground.error().code, ErrorCode::Unavailable);
  }
}

TEST(Thumbnail, HalfTheSizeShowsTheSame) {
  const test::Photo photo = test::takePhoto(coarseGround(), test::sceneCamera(111, 100),
                                            test::lookDown(0, 0, test::kGround + test::kFlight));
  const Thumbnail whole = thumbnailOf(0, photo), half = whole.halved();
  ASSERT_EQ(half.camera.width, 55);
  ASSERT_EQ(half.luma.size(), 55u * static_cast<std::size_t>(half.camera.height));
  EXPECT_EQ(half.camera.fx, whole.camera.fx / 2);
  for (int y = 2; y < half.camera.height - 2; ++y)
    for (int x = 2; x < half.camera.width - 2; ++x)
      EXPECT_NEAR(half.at({x + 0.5, y + 0.5}).value(), whole.at({2 * x + 1.0, 2 * y + 1.0}).value(),
                  1.0 / 255);
}

TEST(ExposureBalance, ComparesLargeFramesToo) {
  ExposureBalance balance;
  for (int i = 0; i < 3; ++i)
    balance.add(thumbnailOf(static_cast<std::uint64_t>(i),
                            test::takePhoto(coarseGround(), test::sceneCamera(330, 300),
                                            test::lookDown(9.0 * i, 0, test::kGround + test::kFlight)),
                            1 - 0.2 * i),
                test::kGround);
  const auto gains = balance.solve();
  ASSERT_EQ(gains.size(), 3u);
  for (int i = 1; i < 3; ++i)
    EXPECT_NEAR(static_cast<double>(gains.at(static_cast<std::uint64_t>(i))) * (1 - 0.2 * i),
                static_cast<double>(gains.at(0)), 0.03);
}

TEST(ExposureBalance, EvensOutGainsWhateverTheOrderOfArrival) {
  const std::vector<double> exposure{1.0, 0.8, 0.65, 0.9};
  const std::vector<test::Photo> photos = strip(coarseGround(), 4);
  ExposureBalance forward, backward;
  for (std::size_t i = 0; i < 4; ++i) {
    forward.add(thumbnailOf(i, photos[i], exposure[i]), test::kGround);
    backward.add(thumbnailOf(3 - i, photos[3 - i], exposure[3 - i]), test::kGround);
  }
  const auto a = forward.solve(), b = backward.solve();
  ASSERT_EQ(a.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(static_cast<double>(a.at(i)) * exposure[i], static_cast<double>(a.at(0)) * exposure[0], 0.03);
    EXPECT_FLOAT_EQ(a.at(i), b.at(i));
  }
}

}  // namespace
}  // namespace overfly::tiling
