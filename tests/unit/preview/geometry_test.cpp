// The square that rays are cast into, how a ray runs in it, and the surfaces over its cells.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "render/preview/domain.h"
#include "render/preview/focus.h"
#include "render/preview/height_grid.h"
#include "render/preview/tile_image.h"
#include "render/preview/view.h"
#include "tests/unit/preview/synthetic_map.h"

namespace overfly::preview {
namespace {

MapExtent extentOf(const geo::TileKey& first, const geo::TileKey& last) {
  MapExtent extent;
  extent.finest_zoom = first.zoom;
  extent.min = geo::TileLattice::planeOf(first);
  extent.max = geo::TileLattice::planeOf({last.zoom, last.x + 1, last.y + 1});
  return extent;
}

RC_GTEST_PROP(PreviewDomain, CoversTheMapWithTwoByTwoTilesBelowTheTop, ()) {
  const auto x = *rc::gen::inRange<std::int64_t>(-5000000, 5000000);
  const auto y = *rc::gen::inRange<std::int64_t>(-5000000, 5000000);
  const auto w = *rc::gen::inRange<std::int64_t>(0, 900), h = *rc::gen::inRange<std::int64_t>(0, 900);
  MapExtent extent = extentOf({23, x, y}, {23, x + w, y + h});
  extent.lattice = geo::TileLattice::local({0.8, 0.2, 0});
  const Domain domain = Domain::create(extent).value();
  RC_ASSERT(domain.tilesAcross(domain.levels() - 2) == 2);
  for (const geo::TileKey& key : {geo::TileKey{23, x, y}, geo::TileKey{23, x + w, y + h}}) {
    const Domain::Place place = domain.place(key);
    RC_ASSERT(place.level == 0);
    RC_ASSERT(domain.key(0, place.x, place.y) == key);
    // Parents in the lattice are parents in the square.
    geo::TileKey parent = key;
    for (int l = 1; l <= domain.levels() - 2; ++l) {
      parent = geo::parentOf(parent);
      const Domain::Place above = domain.place(parent);
      RC_ASSERT(above.level == l);
      RC_ASSERT(above.x == place.x >> l);
      RC_ASSERT(above.y == place.y >> l);
    }
  }
  // No smaller square would do, save for the column or row that is joined.
  if (domain.levels() > 2) RC_ASSERT(std::max(w, h) >= std::int64_t{1} << (domain.levels() - 3));
}

TEST(PreviewDomain, RefusesNothingAndTooMuch) {
  EXPECT_FALSE(Domain::create({}).has_value());
  const auto huge = Domain::create(extentOf({30, 0, 0}, {30, 1 << 24, 1}));
  ASSERT_FALSE(huge.has_value());
  EXPECT_EQ(huge.error().code, ErrorCode::BadInput);
}

// What RayFrame says of the order that it leaves out.
TEST(RayFrame, FollowsTheExactMapToAFewCentimetresAtTenKilometres) {
  for (const double lat : {-33.0, 0.0, 47.67, 70.0}) {
    test::SyntheticMap::Options options;
    options.lat_deg = lat;
    options.tiles = 2;
    test::SyntheticMap map(options, [](int, int) { return 100.0F; });
    const Domain domain = Domain::create(*map.extent()).value();
    const geo::Geodetic position = map.place(0, 0, 700);
    const RayFrame frame = RayFrame::create(domain, position, 100).value();
    const geo::LocalFrame local(position);
    for (int heading = 0; heading < 360; heading += 45) {
      for (const double distance : {100.0, 1000.0, 10000.0}) {
        const double h = geo::radians(heading);
        const Eigen::Vector3d d(std::sin(h) * 0.99, std::cos(h) * 0.99, -std::sqrt(1 - 0.99 * 0.99));
        const Eigen::Vector3d q = frame.at(d, distance);
        const geo::Geodetic exact = geo::geodeticFromEcef(local.ecefFromEnu(d * distance));
        const Eigen::Vector2d texel =
            domain.texelFromPlane(*domain.lattice().planeFromGeodetic(exact.lat, exact.lon, 0.5));
        const Eigen::Vector2d off = (q.head<2>() + frame.cell.cast<double>() - texel) * domain.texelSize();
        // The order that is left out: the cube of the distance; the projection's stretch grows with latitude.
        const double bound = (lat == 70.0 ? 0.07 : 0.02) * std::pow(distance / 1e4, 3) + 1e-4;
        EXPECT_LT(off.norm(), bound) << lat << " " << heading << " " << distance;
        EXPECT_NEAR(q.z() + frame.base_height_m, exact.height_m, bound)
            << lat << " " << heading << " " << distance;
      }
    }
  }
}

TEST(RayFrame, IsAsExactFarFromTheLatticesOriginAsNearIt) {
  // The same place in lattices whose origins are near and 1,000 km away: what float sees is equally small.
  for (const double away_deg : {0.0, 9.0}) {
    test::SyntheticMap::Options options;
    options.lattice = geo::TileLattice::local({geo::radians(47.6712 - away_deg), geo::radians(9.1743), 0});
    test::SyntheticMap map(options, test::townHeight);
    const Domain domain = Domain::create(*map.extent()).value();
    const geo::Geodetic position = map.place(200.25, 180.75, 500);
    const RayFrame frame = RayFrame::create(domain, position, 447).value();
    EXPECT_NEAR(frame.start.x() + frame.cell.x() - domain.minTexel().x(), 200.25, 1e-4);
    EXPECT_NEAR(frame.start.y() + frame.cell.y() - domain.minTexel().y(), 180.75, 1e-4);
    EXPECT_LT(frame.start.head<2>().maxCoeff(), 1);
  }
}

double random(std::mt19937& engine) { return std::uniform_real_distribution<double>(-20, 20)(engine); }

RC_GTEST_PROP(PreviewSurface, LinearAndBicubicAreContinuousAcrossCellsAndBicubicInSlopeToo,
              (std::uint32_t seed)) {
  std::mt19937 engine(seed);
  double field[3][4];
  for (auto& row : field)
    for (double& h : row) h = random(engine);
  Neighbourhood west, east;
  for (std::size_t j = 0; j < 3; ++j) {
    for (std::size_t i = 0; i < 3; ++i) {
      west[3 * j + i] = field[j][i];
      east[3 * j + i] = field[j][i + 1];
    }
  }
  for (const double v : {0.0, 0.2, 0.5, 0.77, 1.0}) {
    for (const Surface surface : {Surface::Linear, Surface::Bicubic})
      RC_ASSERT(std::abs(surfaceHeight(surface, west, 1, v) - surfaceHeight(surface, east, 0, v)) < 1e-9);
    constexpr double kStep = 1e-6;
    const double a =
        (surfaceHeight(Surface::Bicubic, west, 1, v) - surfaceHeight(Surface::Bicubic, west, 1 - kStep, v)) /
        kStep;
    const double b =
        (surfaceHeight(Surface::Bicubic, east, kStep, v) - surfaceHeight(Surface::Bicubic, east, 0, v)) /
        kStep;
    RC_ASSERT(std::abs(a - b) < 1e-2);
  }
}

// What the bounds in GPU memory rest on.
RC_GTEST_PROP(PreviewSurface, NoSurfaceRisesAboveTheHighestOfTheNineTexels, (std::uint32_t seed)) {
  std::mt19937 engine(seed);
  Neighbourhood h;
  for (double& value : h) value = random(engine);
  if (seed % 3 == 0)  // steps, as at walls
    for (double& value : h) value = value > 0 ? 20 : -20;
  const double highest = *std::max_element(h.begin(), h.end());
  for (double u = 0; u <= 1; u += 0.0625)
    for (double v = 0; v <= 1; v += 0.0625)
      for (const Surface surface : {Surface::Blocks, Surface::Linear, Surface::Bicubic})
        RC_ASSERT(surfaceHeight(surface, h, u, v) <= highest + 1e-9);
}

TEST(TileImage, BoundsCoverTheSurfaceAcrossTileBordersAndRimsAreTheNeighbours) {
  test::SyntheticMap map({}, test::holedHeight);
  const Domain domain = Domain::create(*map.extent()).value();
  for (int level = 0; level <= 1; ++level) {
    const HeightGrid grid = HeightGrid::load(domain, map, level).value();
    const int size = domain.tileSize(), across = domain.tilesAcross(level);
    int tiles = 0;
    for (int ty = 0; ty < across; ++ty) {
      for (int tx = 0; tx < across; ++tx) {
        TileBlock block;
        for (int k = 0; k < 9; ++k) {
          const int x = tx + k % 3 - 1, y = ty + k / 3 - 1;
          if (x < 0 || y < 0 || x >= across || y >= across) continue;
          if (auto tile = map.load(domain.key(level, x, y))) block[static_cast<std::size_t>(k)] = *tile;
        }
        if (block[4] == nullptr) continue;
        ++tiles;
        const TileImage image = makeTileImage(block, 440, NoData::Hole);
        for (int y = 0; y < size; ++y) {
          for (int x = 0; x < size; ++x) {
            const int gx = tx * size + x, gy = ty * size + y;
            const float bound = image.bounds[static_cast<std::size_t>(y * size + x)];
            ASSERT_EQ(bound > kNoHeight, grid.valid(gx, gy));
            if (!grid.valid(gx, gy)) continue;
            const Neighbourhood h = grid.around(gx, gy);
            ASSERT_GE(static_cast<double>(bound) + 440, *std::max_element(h.begin(), h.end()) - 1e-4);
            for (int k = 0; k < 9; ++k)
              ASSERT_NEAR(static_cast<double>(
                              image.heights[static_cast<std::size_t>((y + k / 3) * (size + 2) + x + k % 3)]) +
                              440,
                          h[static_cast<std::size_t>(k)], 1e-4);
          }
        }
      }
    }
    EXPECT_GT(tiles, 5);
  }
}

TEST(TileImage, APatchSpansTheHolesWithinTheRangeOfTheData) {
  test::SyntheticMap map({}, test::holedHeight);
  const Domain domain = Domain::create(*map.extent()).value();
  int patched = 0;
  for (int ty = 0; ty < domain.tilesAcross(0); ++ty) {
    for (int tx = 0; tx < domain.tilesAcross(0); ++tx) {
      const auto tile = map.load(domain.key(0, tx, ty));
      if (!tile) continue;
      TileBlock block;
      block[4] = *tile;
      float lowest = 1e30F, highest = -1e30F;
      for (const float h : (*tile)->elevation) {
        lowest = std::fmin(lowest, h);
        highest = std::fmax(highest, h);
      }
      const TileImage image = makeTileImage(block, 0, NoData::Patch);
      for (const float h : image.heights) {
        EXPECT_GE(h, lowest - 1e-3F);
        EXPECT_LE(h, highest + 1e-3F);
      }
      for (std::size_t i = 0; i < image.bounds.size(); ++i) {
        EXPECT_GT(image.bounds[i], kNoHeight);
        const bool data = std::isfinite((*tile)->elevation[i]);
        EXPECT_EQ(image.quality[2 * i + 1] != 0, data);
        patched += data ? 0 : 1;
      }
    }
  }
  EXPECT_GT(patched, 100);
}

TEST(TopImage, HoldsMeansAndMaximaOfAllBelow) {
  test::SyntheticMap map({}, test::townHeight);
  const Domain domain = Domain::create(*map.extent()).value();
  const int level = domain.levels() - 2;
  std::array<SourceTilePtr, 4> children;
  for (int i = 0; i < 4; ++i)
    if (auto tile = map.load(domain.key(level, i & 1, i >> 1))) children[static_cast<std::size_t>(i)] = *tile;
  const TopImage top = makeTopImage(children, domain.tileSize(), 440);
  ASSERT_EQ(static_cast<int>(top.levels.size()), domain.lastLevel() - (domain.levels() - 1) + 1);
  float highest = 0;
  double sum = 0;
  for (int y = 0; y < map.texels(); ++y) {
    for (int x = 0; x < map.texels(); ++x) {
      highest = std::max(highest, test::townHeight(x, y));
      sum += static_cast<double>(test::townHeight(x, y));
    }
  }
  EXPECT_GE(static_cast<double>(top.levels.back().bounds[0]) + 440, static_cast<double>(highest));
  EXPECT_LE(static_cast<double>(top.levels.back().bounds[0]) + 440, static_cast<double>(highest) + 0.01);
  EXPECT_NEAR(static_cast<double>(top.levels.back().heights[4]) + 440, sum / (map.texels() * map.texels()),
              0.5);
}

View viewAt(const test::SyntheticMap& map, double height, double pitch_deg) {
  View view;
  view.position = map.place(300, 300, 447 + height);
  view.pitch = geo::radians(pitch_deg);
  return view;
}

TEST(Focus, TheClipCentreStaysWithinSeventyDegreesOfStraightDown) {
  test::SyntheticMap::Options options;
  options.tiles = 40;
  options.tile_size = 16;
  test::SyntheticMap map(options, [](int, int) { return 447.0F; });
  const Domain domain = Domain::create(*map.extent()).value();
  for (const double pitch : {-90.0, -60.0, -30.0, -10.0, 0.0, 30.0}) {
    const View view = viewAt(map, 50, pitch);
    const RayFrame frame = RayFrame::create(domain, view.position, 447).value();
    const Focus focus = focusOf(view, frame, domain, 447);
    const Eigen::Vector2d foot = frame.start.head<2>() + frame.cell.cast<double>();
    for (const Eigen::Vector2d& centre : focus.centres) {
      const double away = (centre - foot).norm() * domain.texelSize();
      EXPECT_LE(away, 50 * std::tan(geo::radians(70)) * 1.01) << pitch;
      if (pitch == -90) {
        EXPECT_LT(away, 1.0);
      }
      // Northwards, as the view looks: rows grow southwards.
      EXPECT_LE(centre.y(), foot.y() + 1e-6);
    }
    EXPECT_LE(focus.finest, focus.coarsest);
  }
  // Four times as high calls for levels two coarser.
  const auto finest = [&](double height) {
    const View view = viewAt(map, height, -90);
    return focusOf(view, RayFrame::create(domain, view.position, 447).value(), domain, 447).finest;
  };
  EXPECT_EQ(finest(16000) - finest(4000), 2);
}

}  // namespace
}  // namespace overfly::preview
