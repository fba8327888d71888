#include "tiling/tile.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "capture/geo/geodetic.h"

namespace overfly::tiling {
namespace {

bool sameBits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0);
}

}  // namespace

Tile Tile::blank(const geo::TileKey& key, int size) {
  Tile tile;
  tile.key = key;
  tile.size = size;
  const std::size_t n = tile.texels();
  tile.color.assign(4 * n, 0);
  tile.elevation.assign(n, std::numeric_limits<float>::quiet_NaN());
  tile.confidence.assign(n, 0);
  tile.views.assign(n, 0);
  tile.kind.assign(n, kNoData);
  tile.source.assign(n, kNoSource);
  tile.gsd.assign(n, 0);
  tile.angle.assign(n, 0);
  return tile;
}

bool Tile::empty() const {
  for (std::size_t i = 3; i < color.size(); i += 4)
    if (color[i] != 0) return false;
  return std::all_of(elevation.begin(), elevation.end(), [](float h) { return std::isnan(h); });
}

bool operator==(const Tile& a, const Tile& b) {
  return a.key == b.key && a.size == b.size && a.color == b.color && sameBits(a.elevation, b.elevation) &&
         a.confidence == b.confidence && a.views == b.views && a.kind == b.kind && a.source == b.source &&
         a.gsd == b.gsd && a.angle == b.angle && sameBits(a.elevation_max, b.elevation_max) &&
         a.frame_set == b.frame_set;
}

std::uint8_t gsdCode(double gsd_m) {
  if (!(gsd_m > 0)) return 0;
  return static_cast<std::uint8_t>(std::clamp(1 + std::lround(16 * std::log2(gsd_m / 1e-3)), 1L, 255L));
}

std::uint8_t angleCode(double angle) {
  if (!(angle >= 0)) return 0;
  return static_cast<std::uint8_t>(1 + std::min(180L, std::lround(2 * geo::degrees(angle))));
}

double angleFromCode(std::uint8_t code) {
  return code == 0 ? std::numeric_limits<double>::quiet_NaN() : geo::radians((code - 1) / 2.0);
}

double gsdFromCode(std::uint8_t code) {
  return code == 0 ? std::numeric_limits<double>::quiet_NaN() : 1e-3 * std::exp2((code - 1) / 16.0);
}

std::vector<float> elevationMax(const Tile& tile) {
  if (!tile.elevation_max.empty()) return tile.elevation_max;
  const int size = tile.size;
  std::vector<float> across(tile.elevation.size()), bound(tile.elevation.size());
  const auto at = [size](int column, int row) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(size) + static_cast<std::size_t>(column);
  };
  if (tile.elevation.empty()) return bound;
  // fmax ignores a NaN beside a number, which is what "maximum of what is valid" means.
  for (int row = 0; row < size; ++row)
    for (int column = 0; column < size; ++column)
      across[at(column, row)] = std::fmax(tile.elevation[at(column, row)],
                                          std::fmax(tile.elevation[at(std::max(column - 1, 0), row)],
                                                    tile.elevation[at(std::min(column + 1, size - 1), row)]));
  for (int row = 0; row < size; ++row)
    for (int column = 0; column < size; ++column)
      bound[at(column, row)] =
          std::fmax(across[at(column, row)], std::fmax(across[at(column, std::max(row - 1, 0))],
                                                       across[at(column, std::min(row + 1, size - 1))]));
  return bound;
}

std::optional<float> highest(const Tile& tile) {
  float value = std::numeric_limits<float>::quiet_NaN();
  for (float h : tile.elevation) value = std::fmax(value, h);
  if (std::isnan(value)) return std::nullopt;
  return value;
}

std::optional<float> lowest(const Tile& tile) {
  float value = std::numeric_limits<float>::quiet_NaN();
  for (float h : tile.elevation) value = std::fmin(value, h);
  if (std::isnan(value)) return std::nullopt;
  return value;
}

}  // namespace overfly::tiling
