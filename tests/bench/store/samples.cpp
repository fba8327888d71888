#include "tests/bench/store/samples.h"

#include <gdal_priv.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <random>

namespace overfly::tiling {
namespace {

constexpr float kHole = std::numeric_limits<float>::quiet_NaN();
bool real = false;

void cut(const std::filesystem::path& path, std::vector<std::vector<float>>& samples) {
  GDALDatasetUniquePtr file(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER));
  if (!file) return;
  GDALRasterBand* const band = file->GetRasterBand(1);
  int has_hole_value = 0;
  const double hole = band->GetNoDataValue(&has_hole_value);
  for (int y = 0; y + kBenchSize <= band->GetYSize(); y += kBenchSize)
    for (int x = 0; x + kBenchSize <= band->GetXSize(); x += kBenchSize) {
      std::vector<float> heights(kBenchSize * kBenchSize);
      if (band->RasterIO(GF_Read, x, y, kBenchSize, kBenchSize, heights.data(), kBenchSize, kBenchSize,
                         GDT_Float32, 0, 0) != CE_None)
        continue;
      std::size_t valid = 0;
      for (float& height : heights) {
        if (has_hole_value != 0 && height == static_cast<float>(hole)) height = kHole;
        valid += std::isfinite(height) ? 1U : 0U;
      }
      if (3 * valid >= heights.size()) samples.push_back(std::move(heights));
    }
}

std::vector<float> village(unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> noise(0, 0.02F);
  std::vector<float> heights(kBenchSize * kBenchSize);
  for (std::size_t i = 0; i < heights.size(); ++i) {
    const auto x = static_cast<float>(i % kBenchSize), y = static_cast<float>(i / kBenchSize);
    heights[i] = 200 + 0.02F * x + 3 * std::sin(y * 0.02F) + noise(random);
    if (std::fmod(x, 90) > 60 && std::fmod(y, 70) > 50) heights[i] += 6;
  }
  return heights;
}

}  // namespace

const std::vector<std::vector<float>>& elevationSamples() {
  static const std::vector<std::vector<float>> samples = [] {
    std::vector<std::vector<float>> cut_out;
    GDALAllRegister();
    for (const char* flight : {"caliterra", "brighton-beach"})
      cut(std::filesystem::path(OVERFLY_FLIGHTS_DIR) / flight / "dsm_openmvs.tif", cut_out);
    real = !cut_out.empty();
    for (unsigned seed = 0; !real && seed < 8; ++seed) cut_out.push_back(village(seed));
    return cut_out;
  }();
  return samples;
}

bool samplesAreReal() { return !elevationSamples().empty() && real; }

Tile tileOver(std::size_t i) {
  const std::vector<float>& heights = elevationSamples()[i % elevationSamples().size()];
  std::mt19937 random(static_cast<unsigned>(i));
  Tile tile =
      Tile::blank({20, static_cast<std::int64_t>(i % 64), static_cast<std::int64_t>(i / 64)}, kBenchSize);
  tile.frame_set = {1, 2, 3, 4, 5};
  for (std::size_t texel = 0; texel < tile.texels(); ++texel) {
    if (std::isnan(heights[texel])) continue;
    tile.elevation[texel] = heights[texel];
    const auto shade = static_cast<std::uint8_t>(
        std::clamp(90 + 400 * (heights[texel] - heights[texel - (texel % kBenchSize == 0 ? 0 : 1)]), 20.0F,
                   230.0F) +
        static_cast<float>(random() % 16));
    tile.color[4 * texel] = shade;
    tile.color[4 * texel + 1] = static_cast<std::uint8_t>(shade + 10);
    tile.color[4 * texel + 2] = static_cast<std::uint8_t>(shade / 2);
    tile.color[4 * texel + 3] = 255;
    tile.confidence[texel] =
        static_cast<std::uint8_t>(std::min<std::mt19937::result_type>(255, 120 + random() % 100));
    tile.views[texel] = static_cast<std::uint8_t>(3 + texel / 9000 % 3);
    tile.kind[texel] = kMeasured;
    tile.source[texel] = static_cast<std::uint16_t>(texel / 20000);
    tile.gsd[texel] = gsdCode(0.03 + 0.001 * static_cast<double>(texel / 16384));
  }
  return tile;
}

}  // namespace overfly::tiling
