#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "render/preview/tile_source.h"

namespace overfly::bench {

// A square map of any size, made tile by tile as it is asked for: a town of 64 blocks with its roughness and
// colours, over and over, whose means and maxima at every level are exact, on hills longer than the town.
class EndlessMap : public preview::TileSource {
 public:
  EndlessMap(int tiles, int tile_size) : tiles_(tiles), size_(tile_size), town_(town()) {}

  Result<preview::MapExtent> extent() override {
    preview::MapExtent extent;
    extent.tile_size = size_;
    extent.finest_zoom = kZoom;
    extent.min = geo::TileLattice::planeOf(corner());
    extent.max = geo::TileLattice::planeOf({kZoom, corner().x + tiles_, corner().y + tiles_});
    return extent;
  }
  Result<preview::SourceTilePtr> load(const geo::TileKey& key) override {
    const int level = kZoom - key.zoom;
    const std::int64_t x0 = key.x - (corner().x >> level), y0 = key.y - (corner().y >> level);
    const std::int64_t last = (tiles_ - 1) >> level;
    if (level < 0 || x0 < 0 || y0 < 0 || x0 > last || y0 > last)
      return fail(ErrorCode::NotFound, "beyond the map");
    auto tile = std::make_shared<preview::SourceTile>();
    tile->key = key;
    tile->revision = 1;
    tile->size = size_;
    tile->life = life;
    tile->grace = grace;
    const auto texels = static_cast<std::size_t>(size_) * static_cast<std::size_t>(size_);
    tile->color.reserve(4 * texels);
    tile->elevation.reserve(texels);
    tile->elevation_max.reserve(texels);
    tile->confidence.assign(texels, 200);
    const Town& town = town_[static_cast<std::size_t>(std::min(level, kTownLevels))];
    const double texel = std::ldexp(1.0, level);
    const Waves east = wavesAt(x0 * size_, texel), south = wavesAt(y0 * size_, texel);
    for (int y = 0; y < size_; ++y) {
      for (int x = 0; x < size_; ++x) {
        const std::int64_t gx = x0 * size_ + x, gy = y0 * size_ + y;
        const std::size_t i = town.index(gx, gy);
        const auto u = static_cast<std::size_t>(x), v = static_cast<std::size_t>(y);
        const double hill = kGround + 4 * east.sin4000[u] * south.cos5000[v] +
                            2 * (east.sin2500[u] * south.cos3000[v] + east.cos2500[u] * south.sin3000[v]);
        tile->elevation.push_back(static_cast<float>(hill) + town.mean[i]);
        // A hill rises by at most its steepest slope to the farthest point that the surface over a texel
        // uses.
        tile->elevation_max.push_back(static_cast<float>(hill + 1.5 * kHillSlope * texel) + town.highest[i]);
        tile->color.insert(tile->color.end(), &town.color[4 * i], &town.color[4 * i] + 4);
      }
    }
    return preview::SourceTilePtr(std::move(tile));
  }
  Result<std::vector<geo::TileKey>> changes(std::uint64_t&) override { return std::vector<geo::TileKey>{}; }

  geo::Geodetic middle(double height_m) const {
    geo::Geodetic place = geo::TileLattice::webMercator().geodeticFromPlane(
        geo::TileLattice::planeOf({kZoom, corner().x + tiles_ / 2, corner().y + tiles_ / 2}, 0.3, 0.4));
    place.height_m = height_m;
    return place;
  }
  static constexpr double kGround = 450;  // metres; everything lies between this - 8 and + 20

  std::optional<std::chrono::nanoseconds> life, grace;  // of tiles loaded from now on

 private:
  static constexpr int kZoom = 21;              // 5 cm a texel of a tile of 256
  static constexpr int kTownLevels = 11;        // 2048 texels across at level 0
  static constexpr double kHillSlope = 0.0026;  // metres per texel of level 0 (5 %)
  // A corner that is aligned at every level, so that rows and columns count from it.
  static geo::TileKey corner() { return {kZoom, (1100000 >> 12) << 12, (732000 >> 12) << 12}; }
  // The hills 4 sin(x / 4000) cos(y / 5000) + 2 sin(x / 2500 + y / 3000), by a tile's columns and rows.
  struct Waves {
    std::vector<double> sin4000, cos5000, sin2500, cos2500, sin3000, cos3000;
  };
  Waves wavesAt(std::int64_t first, double texel) const {
    Waves out;
    for (int i = 0; i < size_; ++i) {
      const double at = (static_cast<double>(first + i) + 0.5) * texel;
      out.sin4000.push_back(std::sin(at / 4000));
      out.cos5000.push_back(std::cos(at / 5000));
      out.sin2500.push_back(std::sin(at / 2500));
      out.cos2500.push_back(std::cos(at / 2500));
      out.sin3000.push_back(std::sin(at / 3000));
      out.cos3000.push_back(std::cos(at / 3000));
    }
    return out;
  }

  // One level of the town: means, and maxima over what the surface over a texel uses, of this and finer
  // levels.
  struct Town {
    int across = 0;
    std::vector<float> mean, highest;
    std::vector<std::uint8_t> color;
    [[nodiscard]] std::size_t index(std::int64_t x, std::int64_t y) const {
      const std::int64_t mask = across - 1;
      return static_cast<std::size_t>((y & mask) * across + (x & mask));
    }
    void dilate() {
      for (int y = 0; y < across; ++y)
        for (int x = 0; x < across; ++x)
          for (int j = -1; j <= 1; ++j)
            for (int i = -1; i <= 1; ++i)
              highest[index(x, y)] = std::max(highest[index(x, y)], mean[index(x + i, y + j)]);
    }
  };
  static std::vector<Town> town() {
    std::vector<Town> levels(kTownLevels + 1);
    Town& finest = levels[0];
    finest.across = 1 << kTownLevels;
    const auto hash = [](std::uint32_t n) {
      n = (n ^ (n >> 15)) * 0x2c1b3c6dU;
      return n ^ (n >> 13);
    };
    for (int y = 0; y < finest.across; ++y) {
      for (int x = 0; x < finest.across; ++x) {
        const std::uint32_t block =
            hash(static_cast<std::uint32_t>((y / 256) * 8 + x / 256) * 0x8da6b343U + 7);
        const int width = 90 + static_cast<int>(block & 63U),
                  depth = 80 + static_cast<int>((block >> 6) & 63U);
        const bool built = x % 256 >= 40 && x % 256 < 40 + width && y % 256 >= 40 && y % 256 < 40 + depth;
        const double rough =
            static_cast<double>(hash(static_cast<std::uint32_t>(y * finest.across + x)) & 255U) / 255;
        const double wave = 0.3 * std::sin(x * 6.28318530718 / 64) * std::sin(y * 6.28318530718 / 128);
        finest.mean.push_back(static_cast<float>(wave + 0.04 * rough +
                                                 (built ? 4 + static_cast<double>((block >> 12) & 7U) : 0)));
        const double shade =
            110 + 40 * std::sin(x * 6.28318530718 / 32) * std::sin(y * 6.28318530718 / 32) + 40 * rough;
        finest.color.insert(finest.color.end(),
                            {static_cast<std::uint8_t>(built ? 190 : 80), static_cast<std::uint8_t>(shade),
                             static_cast<std::uint8_t>(built ? 150 : 60), 255});
      }
    }
    finest.highest = finest.mean;
    finest.dilate();
    for (std::size_t l = 1; l < levels.size(); ++l) {
      const Town& below = levels[l - 1];
      Town& level = levels[l];
      level.across = below.across / 2;
      for (int y = 0; y < level.across; ++y) {
        for (int x = 0; x < level.across; ++x) {
          float sum = 0, highest = -1e30F;
          unsigned color[4] = {2, 2, 2, 2};
          for (int k = 0; k < 4; ++k) {
            const std::size_t i = below.index(2 * x + (k & 1), 2 * y + (k >> 1));
            sum += below.mean[i];
            highest = std::max(highest, below.highest[i]);
            for (std::size_t c = 0; c < 4; ++c) color[c] += below.color[4 * i + c];
          }
          level.mean.push_back(sum / 4);
          level.highest.push_back(highest);
          for (const unsigned c : color) level.color.push_back(static_cast<std::uint8_t>(c / 4));
        }
      }
      level.dilate();
    }
    return levels;
  }

  int tiles_, size_;
  std::vector<Town> town_;
};

}  // namespace overfly::bench
