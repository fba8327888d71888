// Nothing shows where tiles meet.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/stress/hard_case/hard_case.h"
#include "tests/stress/sweep/mapped_scene.h"

namespace overfly::test {
namespace {

class Border : public GlTest {};

double medianOf(std::vector<double> values) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// Light from the north-west, as the link shades it: what an eye would see of a step.
double shadeOf(double west_east_m, double texel_m) {
  const double slope = west_east_m / texel_m;
  return (1 + slope) / std::sqrt(2 * (1 + slope * slope));
}

TEST_F(Border, StepsAcrossTileBordersAreThoseInside) {
  const MappedScene scene(hills(), 4, 3);
  const std::unique_ptr<tiling::Mapper> mapper = MappedScene::mapper(context());
  std::set<geo::TileKey> cells;
  for (std::size_t i = 0; i < scene.size(); ++i) cells.merge(scene.add(*mapper, i));
  (void)mapper->balanceExposure();
  const auto tiles = MappedScene::finish(*mapper, cells);
  std::vector<double> height_border, height_inside, colour_border, colour_inside, shade_border, shade_inside;
  const auto grey = [](const tiling::Tile& tile, std::size_t i) {
    return static_cast<double>(tile.color[4 * i]);
  };
  const double texel = mapper->ground().texel_m;
  for (const auto& [key, tile] : tiles) {
    const auto east = tiles.find({key.zoom, key.x + 1, key.y});
    for (std::size_t y = 0; y < kTexels; ++y) {
      const auto row = y * kTexels;
      const auto step = [&](const tiling::Tile& a, std::size_t ia, const tiling::Tile& b, std::size_t ib,
                            std::vector<double>& heights, std::vector<double>& colours,
                            std::vector<double>& shades) {
        if ((a.kind[ia] & tiling::kMeasured) == 0 || (b.kind[ib] & tiling::kMeasured) == 0) return;
        const double rise = static_cast<double>(b.elevation[ib]) - static_cast<double>(a.elevation[ia]);
        heights.push_back(std::abs(rise));
        colours.push_back(std::abs(grey(b, ib) - grey(a, ia)));
        shades.push_back(std::abs(shadeOf(rise, texel) - shadeOf(0, texel)));
      };
      for (std::size_t x = 8; x + 8 < kTexels; ++x)
        step(tile, row + x, tile, row + x + 1, height_inside, colour_inside, shade_inside);
      if (east != tiles.end())
        step(tile, row + kTexels - 1, east->second, row, height_border, colour_border, shade_border);
    }
  }
  ASSERT_GT(height_border.size(), 300u);
  expectAtMost("border/heights", "median step across borders over that of interior lines",
               medianOf(height_border) / medianOf(height_inside), 1.05);
  expectAtMost("border/colours", "median colour step across borders over that of interior lines",
               (medianOf(colour_border) + 1) / (medianOf(colour_inside) + 1), 1.05);
  expectAtMost("border/shading", "median change of shading across borders over that of interior lines",
               medianOf(shade_border) / medianOf(shade_inside), 1.05);
}

}  // namespace
}  // namespace overfly::test
