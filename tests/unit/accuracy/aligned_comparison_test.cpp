#include "tiling/accuracy/aligned_comparison.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace overfly::tiling {
namespace {

constexpr int kZoom = 19, kSize = 128;
constexpr double kGsd_m = 0.25, kHalf_m = 45;

// Nine tiles of rolling ground around a place, with a dome of the given curvature on top.
struct Fixture {
  geo::Geodetic origin{geo::radians(47), geo::radians(9), 500};
  geo::LocalFrame local{origin};
  geo::TileLattice lattice = geo::TileLattice::webMercator();
  std::map<geo::TileKey, Tile> tiles;

  static double ground(double x, double y) { return 3 * std::sin(x / 9) + 2 * std::cos(y / 7); }

  explicit Fixture(double dome_per_m2 = 0) {
    const geo::TileKey centre =
        geo::TileLattice::keyAt(*lattice.planeFromGeodetic(origin.lat, origin.lon), kZoom);
    for (std::int64_t dy = -1; dy <= 1; ++dy)
      for (std::int64_t dx = -1; dx <= 1; ++dx) {
        const geo::TileKey key{kZoom, centre.x + dx, centre.y + dy};
        Tile tile = Tile::blank(key, kSize);
        for (int j = 0; j < kSize; ++j)
          for (int i = 0; i < kSize; ++i) {
            geo::Geodetic place = lattice.geodeticFromPlane(
                geo::TileLattice::planeOf(key, (i + 0.5) / kSize, (j + 0.5) / kSize));
            place.height_m = origin.height_m;
            const Eigen::Vector3d p = local.enuFromEcef(geo::ecefFromGeodetic(place));
            const auto at = static_cast<std::size_t>(j) * kSize + static_cast<std::size_t>(i);
            tile.elevation[at] = static_cast<float>(origin.height_m + ground(p.x(), p.y()) +
                                                    dome_per_m2 * p.head<2>().squaredNorm());
            tile.kind[at] = kMeasured;
          }
        tiles.emplace(key, std::move(tile));
      }
  }

  // Points of the ground without a dome, as a reference sees them whose frame is not the map's.
  [[nodiscard]] std::vector<ReferencePoint> points(const geo::Similarity& map_from_reference) const {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> place(-kHalf_m, kHalf_m);
    std::vector<ReferencePoint> out;
    for (int i = 0; i < 600; ++i) {
      const double x = place(random), y = place(random);
      const Eigen::Vector3d seen = map_from_reference.turn.transpose() *
                                   (Eigen::Vector3d(x, y, ground(x, y)) - map_from_reference.shift) /
                                   map_from_reference.scale;
      out.push_back({geo::geodeticFromEcef(local.ecefFromEnu(seen)), 3});
    }
    return out;
  }
  [[nodiscard]] AlignedComparison compare(std::span<const ReferencePoint> reference) const {
    return compareAligned(tiles, lattice, kZoom, 0.5, reference, local, kGsd_m, {});
  }
};

geo::Similarity someSimilarity() {
  geo::Similarity s;
  s.scale = 1.003;
  s.turn = Eigen::AngleAxisd(geo::radians(0.4), Eigen::Vector3d(1, -2, 0.5).normalized()).toRotationMatrix();
  s.shift = {0.4, -0.3, 3};
  return s;
}

TEST(AlignedComparison, ASimilarityIsTakenAway) {
  const Fixture map;
  const geo::Similarity truth = someSimilarity();
  const AlignedComparison c = map.compare(map.points(truth));
  EXPECT_EQ(c.fitted_points, 300u);
  EXPECT_EQ(c.all.points, 300u);
  EXPECT_EQ(c.all.measured, c.all.points);
  EXPECT_LT(c.all.nmad, 0.1);
  EXPECT_NEAR(c.all.median, 0, 0.1);
  EXPECT_LT(c.dome_corner, 0.2);
  for (const double x : {-kHalf_m, kHalf_m})
    for (const double y : {-kHalf_m, kHalf_m})
      EXPECT_NEAR((c.map_from_reference({x, y, 0}) - truth({x, y, 0})).norm(), 0, 0.1);
}

TEST(AlignedComparison, ADomeStaysAndIsStated) {
  // Corner less the plane that fits best over a square: 4/3 of the curvature times the half side squared.
  const double corner_gsd = 4, curvature = 0.75 * corner_gsd * kGsd_m / (kHalf_m * kHalf_m);
  const Fixture map(curvature);
  const AlignedComparison c = map.compare(map.points(someSimilarity()));
  EXPECT_NEAR(c.dome_corner, corner_gsd, 0.25 * corner_gsd);
  EXPECT_GT(c.dome[0], 0);
  EXPECT_GT(c.dome[2], 0);
  EXPECT_NEAR(std::abs(c.corner_form.dot(c.dome)), c.dome_corner, 1e-9);
  EXPECT_NEAR(c.rms_form.cwiseProduct(c.dome * c.dome.transpose()).sum(), c.dome_rms * c.dome_rms, 1e-9);
  EXPECT_LT(c.dome_rms, 0.6 * c.dome_corner);
  EXPECT_GT(c.all.nmad, 0.5);
}

TEST(AlignedComparison, UmeyamaFindsTheSimilarityOfPairs) {
  const geo::Similarity truth = someSimilarity();
  std::vector<Eigen::Vector3d> from{{0, 0, 0}, {50, 3, 1}, {-20, 40, 5}, {7, -30, 60}}, to;
  for (const auto& p : from) to.push_back(truth(p));
  const geo::Similarity s = geo::similarityBetween(from, to);
  EXPECT_NEAR(s.scale, truth.scale, 1e-9);
  EXPECT_LT((s.turn - truth.turn).norm(), 1e-9);
  EXPECT_LT((s.shift - truth.shift).norm(), 1e-6);
}

}  // namespace
}  // namespace overfly::tiling
