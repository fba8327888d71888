#include "tiling/accuracy/border_steps.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace overfly::tiling {
namespace {

double median(std::vector<double>& values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

BorderSteps borderSteps(const std::map<geo::TileKey, Tile>& tiles, int lattice_lines) {
  std::vector<double> across, inside;
  for (const auto& [key, tile] : tiles) {
    const auto n = static_cast<std::size_t>(tile.size);
    const auto add = [&](std::vector<double>& to, const Tile& a, std::size_t i, const Tile& b,
                         std::size_t j) {
      if ((a.kind[i] & kMeasured) != 0 && (b.kind[j] & kMeasured) != 0)
        to.push_back(std::abs(static_cast<double>(a.elevation[i]) - static_cast<double>(b.elevation[j])));
    };
    for (std::size_t y = 0; y < n; ++y)
      for (std::size_t x = 0; x < n; ++x) {
        if (x + 1 < n) add(inside, tile, y * n + x, tile, y * n + x + 1);
        if (y + 1 < n) add(inside, tile, y * n + x, tile, (y + 1) * n + x);
      }
    const auto east = tiles.find({key.zoom, key.x + 1, key.y});
    if (east != tiles.end() && (key.x + 1) % lattice_lines == 0)
      for (std::size_t y = 0; y < n; ++y) add(across, tile, y * n + n - 1, east->second, y * n);
    const auto south = tiles.find({key.zoom, key.x, key.y + 1});
    if (south != tiles.end() && (key.y + 1) % lattice_lines == 0)
      for (std::size_t x = 0; x < n; ++x) add(across, tile, (n - 1) * n + x, south->second, x);
  }
  BorderSteps steps;
  steps.borders = across.size();
  steps.insides = inside.size();
  steps.across_borders_m = median(across);
  steps.inside_m = median(inside);
  return steps;
}

}  // namespace overfly::tiling
