// The same scene anywhere on Earth gives the same map: no origin, zone edge, pole or antimeridian shows.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "tests/stress/hard_case/hard_case.h"
#include "tests/stress/sweep/placed_scene.h"
#include "tiling/mapping/guess_surface.h"

namespace overfly::test {
namespace {

using geo::radians;

class Place : public GlTest {};

// The named places of the torture list first, then random ones of the whole globe.
std::vector<geo::Geodetic> places(int count) {
  std::vector<geo::Geodetic> list{
      {radians(47.38), radians(8.54), 455},     {0, 0, 0},
      {radians(84.0), radians(-35), 20},        {radians(89.9995), radians(12), 5},
      {radians(12.0), radians(179.99999), 3},   {radians(12.0), radians(-179.99999), 3},
      {radians(48.0), radians(6.0), 300},       {radians(48.0), radians(11.99999), 500},
      {radians(-33.9), radians(18.42), 40},     {radians(31.5), radians(35.48), -430},
      {radians(-32.65), radians(-70.01), 6000}, {radians(-89.9995), radians(0), 2800}};
  std::mt19937 random(2026);
  std::uniform_real_distribution<double> unit(-1, 1);
  while (static_cast<int>(list.size()) < count)
    list.push_back(
        {std::asin(unit(random)), radians(180) * unit(random), 2900 * (unit(random) + 1) + 100 - 430});
  list.resize(static_cast<std::size_t>(count));
  return list;
}

// How much longer the tile's texels are at a height than on the ellipsoid.
double stretchAt(const geo::TileFrame& frame, double height_m) {
  const auto side = [&](double h) {
    return (frame.enuFromTexelExact(1, 0.5, h) - frame.enuFromTexelExact(0, 0.5, h)).norm();
  };
  return side(height_m) / side(0);
}

// The direction of the tile's rows, radians from east, counter-clockwise: near a pole they turn within
// metres.
double azimuthOf(const geo::TileFrame& frame) {
  const Eigen::Vector3d along = frame.enuFromTexelExact(1, 0.5, 0) - frame.enuFromTexelExact(0, 0.5, 0);
  return std::atan2(along.y(), along.x());
}

TEST_F(Place, ElevationAndColourAreTheSameEverywhere) {
  const PlacedViews views(context(), fivePhotos(lookOf(hills())));
  auto sweeper = tiling::Sweeper::create(context());
  auto orthographer = tiling::Orthographer::create(context());
  ASSERT_TRUE(sweeper.has_value() && orthographer.has_value());
  std::vector<double> reference;
  std::vector<std::uint8_t> reference_confidence, reference_color;
  double worst_share = 1, worst_colour = 0, worst_apart = 0;
  for (const geo::Geodetic& place : places(countFrom("OVERFLY_PLACES", 200))) {
    const geo::TileFrame frame = localTile(place.lat, place.lon);
    const double stretch = stretchAt(frame, place.height_m);
    auto field =
        (*sweeper)->run(gridOf(frame, place.height_m, stretch),
                        views.at(frame.local(), place.height_m, stretch, false, azimuthOf(frame)), {});
    ASSERT_TRUE(field.has_value()) << field.error().message;
    std::vector<double> heights;
    std::vector<float> surface = tiling::guessSurface(field->height, field->side(), 0.6, place.height_m);
    for (const float h : field->height)
      heights.push_back((static_cast<double>(h) - place.height_m) / stretch);
    const std::vector<std::uint8_t> guessed(surface.size(), 0);
    auto photo =
        (*orthographer)
            ->render({&frame, kTexels, kApron, surface, guessed},
                     views.orthoAt(frame.local(), place.height_m, stretch, azimuthOf(frame)), kTexels);
    ASSERT_TRUE(photo.has_value()) << photo.error().message;
    if (reference.empty()) {
      reference = heights;
      reference_confidence = field->confidence;
      reference_color = photo->color;
      continue;
    }
    std::size_t confident = 0, same = 0;
    std::vector<double> apart;
    for (std::size_t i = 0; i < heights.size(); ++i) {
      if (reference_confidence[i] < kConfident) continue;
      ++confident;
      if (!std::isnan(heights[i]) && !std::isnan(reference[i]))
        apart.push_back(std::abs(heights[i] - reference[i]));
      same += std::abs(heights[i] - reference[i]) <= 0.001 ? 1 : 0;
    }
    const double share = static_cast<double>(same) / static_cast<double>(confident);
    std::sort(apart.begin(), apart.end());
    worst_apart = std::max(worst_apart, apart[apart.size() * 99 / 100]);
    worst_share = std::min(worst_share, share);
    std::vector<int> differences;
    for (std::size_t i = 0; i < reference_color.size(); ++i)
      differences.push_back(
          std::abs(static_cast<int>(photo->color[i]) - static_cast<int>(reference_color[i])));
    const auto at =
        differences.begin() + static_cast<std::ptrdiff_t>(0.999 * static_cast<double>(differences.size()));
    std::nth_element(differences.begin(), at, differences.end());
    worst_colour = std::max(worst_colour, static_cast<double>(*at));
  }
  expectKnownLimit({"place/elevation-1-mm", "least share of confident texels within 1 mm, any two places",
                    worst_share, HardCase::Must::BeAtLeast, 0.999});
  expectAtMost("place/elevation", "difference at the 99th percentile, GSD, any two places",
               worst_apart / kPixel, 0.25);
  expectAtMost("place/colour", "colour difference at the 99.9th percentile, of 255", worst_colour, 2);
}

TEST_F(Place, ErrorsAreTheSameOnWebMercator) {
  const Scene scene = hills();
  const PlacedViews views(context(), fivePhotos(lookOf(scene)));
  auto sweeper = tiling::Sweeper::create(context());
  ASSERT_TRUE(sweeper.has_value());
  const geo::TileLattice lattice = geo::TileLattice::webMercator();
  double least = 1e9, most = 0;
  for (const geo::Geodetic& place : places(countFrom("OVERFLY_PLACES", 200))) {
    if (std::abs(place.lat) > radians(84.5)) continue;
    const int zoom = lattice.zoomForGsd(0.3, place.lat, place.lon, kTexels);
    const auto plane = lattice.planeFromGeodetic(place.lat, place.lon);
    ASSERT_TRUE(plane.has_value());
    const geo::TileFrame frame(lattice, geo::TileLattice::keyAt(*plane, zoom));
    // Zooms fit a GSD only within a factor of the root of 2: the scene is as much larger or smaller.
    const double texel = lattice.texelSize(zoom, place.lat, place.lon, kTexels);
    const double stretch = texel / 0.3;
    auto field = (*sweeper)->run(gridOf(frame, place.height_m, stretch),
                                 views.at(frame.local(), place.height_m, stretch), {});
    ASSERT_TRUE(field.has_value()) << field.error().message;
    const double rms =
        FieldErrors::rms(errorsOf(*field, frame, scene.ground, place.height_m, stretch).all) / kPixel;
    least = std::min(least, rms);
    most = std::max(most, rms);
  }
  expectAtMost("place/web-mercator", "largest over smallest RMSE in GSD", most / least, 1.2);
  expectAtMost("place/web-mercator", "largest RMSE, GSD", most, 0.25 * kUp / 9);
}

TEST_F(Place, TwoHundredKilometresAwayTheErrorIsTheSame) {
  const Scene scene = hills();
  const PlacedViews views(context(), fivePhotos(lookOf(scene)));
  const geo::TileLattice lattice = geo::TileLattice::local({radians(47.38), radians(8.54), 0});
  std::vector<double> rms;
  for (const double km : {0.0, 1.0, 10.0, 50.0, 200.0}) {
    const double cells = std::exp2(kZoom) * km * 1000 / geo::TileLattice::kCellMetres;
    const geo::TileFrame frame(lattice, {kZoom, static_cast<std::int64_t>(cells), 0});
    const tiling::HeightField field = sweepOf(context(), gridOf(frame, 455), views.at(frame.local(), 455));
    rms.push_back(FieldErrors::rms(errorsOf(field, frame, scene.ground, 455).all));
  }
  double worst = 1;
  for (const double r : rms) worst = std::max(worst, r / rms.front());
  expectAtMost("distance/200-km", "RMSE against that at the origin", worst, 1.1);
}

// A level surface keeps its ellipsoidal height; a map that took the Earth for flat would be 7.8 m off.
TEST_F(Place, ALevelSurfaceOfTenKilometresIsLevel) {
  const PlacedViews views(context(), fivePhotos(lookOf(flat())));
  const geo::TileLattice lattice = geo::TileLattice::webMercator();
  const auto plane = lattice.planeFromGeodetic(radians(47.38), radians(8.54));
  ASSERT_TRUE(plane.has_value());
  std::vector<double> means;
  for (int i = 0; i <= 4; ++i) {
    geo::TileKey key = geo::TileLattice::keyAt(*plane, 20);
    key.x += i * 97;  // 97 cells of 25.9 m
    const geo::TileFrame frame(lattice, key);
    const tiling::HeightField field = sweepOf(context(), gridOf(frame, 455), views.at(frame.local(), 455));
    double sum = 0;
    std::size_t count = 0;
    for (const float h : field.height)
      if (!std::isnan(h)) {
        sum += static_cast<double>(h);
        ++count;
      }
    means.push_back(sum / static_cast<double>(count));
  }
  const auto [low, high] = std::minmax_element(means.begin(), means.end());
  expectAtMost("distance/level-surface", "difference of mean heights along 10 km, m", *high - *low, 0.01);
}

}  // namespace
}  // namespace overfly::test
