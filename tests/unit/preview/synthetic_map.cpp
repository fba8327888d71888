#include "tests/unit/preview/synthetic_map.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace overfly::test {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

std::size_t at(int x, int y, int size) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(size) + static_cast<std::size_t>(x);
}

// Maximum over each texel and its neighbours in the tile: what the bilinear surface can reach.
std::vector<float> neighbourMaximum(const std::vector<float>& heights, int size) {
  std::vector<float> out(heights.size(), kNan);
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x)
      for (int j = std::max(y - 1, 0); j <= std::min(y + 1, size - 1); ++j)
        for (int i = std::max(x - 1, 0); i <= std::min(x + 1, size - 1); ++i)
          out[at(x, y, size)] = std::fmax(out[at(x, y, size)], heights[at(i, j, size)]);
  return out;
}

std::uint32_t hash(int x, int y) {
  std::uint32_t h = static_cast<std::uint32_t>(x) * 0x8da6b343U + static_cast<std::uint32_t>(y) * 0xd8163841U;
  h ^= h >> 15;
  h *= 0x2c1b3c6dU;
  return h ^ (h >> 13);
}

}  // namespace

SyntheticMap::SyntheticMap(const Options& options, Height height) : options_(options) {
  const auto plane =
      options_.lattice.planeFromGeodetic(geo::radians(options_.lat_deg), geo::radians(options_.lon_deg));
  corner_ = geo::TileLattice::keyAt(*plane, options_.zoom);
  const std::int64_t last_x = corner_.x + options_.tiles - 1, last_y = corner_.y + options_.tiles - 1;
  while ((last_x >> levels_) - (corner_.x >> levels_) > 1 || (last_y >> levels_) - (corner_.y >> levels_) > 1)
    ++levels_;
  for (int y = 0; y < options_.tiles; ++y)
    for (int x = 0; x < options_.tiles; ++x) makeTile(x, y, height);
  for (int l = 1; l <= levels_; ++l)
    for (std::int64_t y = corner_.y >> l; y <= last_y >> l; ++y)
      for (std::int64_t x = corner_.x >> l; x <= last_x >> l; ++x) makeParent({options_.zoom - l, x, y});
}

void SyntheticMap::makeTile(int tile_x, int tile_y, const Height& height) {
  const int size = options_.tile_size;
  auto tile = std::make_shared<preview::SourceTile>();
  tile->key = {corner_.zoom, corner_.x + tile_x, corner_.y + tile_y};
  tile->revision = ++revision_;
  tile->size = size;
  bool any = false;
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      const int gx = tile_x * size + x, gy = tile_y * size + y;
      const float h = height(gx, gy);
      any = any || std::isfinite(h);
      tile->elevation.push_back(h);
      const bool valid = std::isfinite(h);
      std::array<std::uint8_t, 3> color{};
      if (valid && options_.color) {
        color = options_.color(gx, gy);
      } else if (valid) {
        const std::uint32_t noise = hash(gx / 2, gy / 2) & 31U;
        const bool check = (((gx >> 3) ^ (gy >> 3)) & 1) != 0;
        color = {static_cast<std::uint8_t>((tile_x * 37 + 80) & 255),
                 static_cast<std::uint8_t>(90 + noise + (check ? 60 : 0)),
                 static_cast<std::uint8_t>((tile_y * 53 + 60) & 255)};
      }
      tile->color.insert(tile->color.end(),
                         {color[0], color[1], color[2], static_cast<std::uint8_t>(valid ? 255 : 0)});
      tile->confidence.push_back(static_cast<std::uint8_t>(255 * gx / std::max(texels(), 1)));
    }
  }
  tile->elevation_max = neighbourMaximum(tile->elevation, size);
  if (any) tiles_[tile->key] = tile;
}

void SyntheticMap::makeParent(const geo::TileKey& key) {
  const int size = options_.tile_size;
  auto tile = std::make_shared<preview::SourceTile>();
  tile->key = key;
  tile->revision = ++revision_;
  tile->size = size;
  tile->color.assign(4 * at(0, size, size), 0);
  tile->elevation.assign(at(0, size, size), kNan);
  tile->confidence.assign(at(0, size, size), 0);
  std::vector<float> below(at(0, size, size), kNan);
  bool any = false;
  for (int i = 0; i < 4; ++i) {
    const auto found = tiles_.find(geo::childOf(key, i));
    if (found == tiles_.end()) continue;
    any = true;
    const preview::SourceTile& child = *found->second;
    for (int y = 0; y < size / 2; ++y) {
      for (int x = 0; x < size / 2; ++x) {
        const std::size_t to = at(x + (i & 1) * size / 2, y + (i >> 1) * size / 2, size);
        double sum = 0;
        unsigned count = 0, color[3] = {0, 0, 0}, confidence = 0;
        for (int k = 0; k < 4; ++k) {
          const std::size_t from = at(2 * x + (k & 1), 2 * y + (k >> 1), size);
          below[to] = std::fmax(below[to], child.elevation_max[from]);
          if (!std::isfinite(child.elevation[from])) continue;
          sum += static_cast<double>(child.elevation[from]);
          for (std::size_t c = 0; c < 3; ++c) color[c] += child.color[4 * from + c];
          confidence += child.confidence[from];
          ++count;
        }
        if (count == 0) continue;
        tile->elevation[to] = static_cast<float>(sum / count);
        for (std::size_t c = 0; c < 3; ++c)
          tile->color[4 * to + c] = static_cast<std::uint8_t>(color[c] / count);
        tile->color[4 * to + 3] = 255;
        tile->confidence[to] = static_cast<std::uint8_t>(confidence / count);
      }
    }
  }
  tile->elevation_max = neighbourMaximum(tile->elevation, size);
  for (std::size_t i = 0; i < below.size(); ++i)
    tile->elevation_max[i] = std::fmax(tile->elevation_max[i], below[i]);
  if (any) tiles_[key] = tile;
}

Result<preview::MapExtent> SyntheticMap::extent() {
  const std::scoped_lock lock(mutex_);
  preview::MapExtent extent;
  extent.lattice = options_.lattice;
  extent.tile_size = options_.tile_size;
  extent.finest_zoom = options_.zoom;
  extent.min = geo::TileLattice::planeOf(corner_);
  extent.max =
      geo::TileLattice::planeOf({corner_.zoom, corner_.x + options_.tiles, corner_.y + options_.tiles});
  extent.revision = revision_;
  return extent;
}

Result<preview::SourceTilePtr> SyntheticMap::load(const geo::TileKey& key) {
  const std::scoped_lock lock(mutex_);
  ++loads_;
  const auto found = tiles_.find(key);
  if (found == tiles_.end()) return fail(ErrorCode::NotFound, "no such tile");
  auto copy = std::make_shared<preview::SourceTile>(*found->second);
  copy->life = life_;
  copy->grace = grace_;
  return preview::SourceTilePtr(std::move(copy));
}

Result<std::vector<geo::TileKey>> SyntheticMap::changes(std::uint64_t& since) {
  const std::scoped_lock lock(mutex_);
  std::vector<geo::TileKey> keys;
  for (const auto& [key, tile] : tiles_)
    if (tile->revision > since) keys.push_back(key);
  for (const auto& [key, revision] : erased_)
    if (revision > since) keys.push_back(key);
  since = revision_;
  return keys;
}

void SyntheticMap::change(int tile_x, int tile_y, const Height& height, bool parents) {
  const std::scoped_lock lock(mutex_);
  makeTile(tile_x, tile_y, height);
  if (!parents) return;
  for (int l = 1; l <= levels_; ++l)
    makeParent({corner_.zoom - l, (corner_.x + tile_x) >> l, (corner_.y + tile_y) >> l});
}

void SyntheticMap::erase(const geo::TileKey& key) {
  const std::scoped_lock lock(mutex_);
  tiles_.erase(key);
  erased_[key] = ++revision_;
}

void SyntheticMap::setLife(std::optional<std::chrono::nanoseconds> life,
                           std::optional<std::chrono::nanoseconds> grace) {
  const std::scoped_lock lock(mutex_);
  life_ = life;
  grace_ = grace;
}

geo::Geodetic SyntheticMap::place(double x, double y, double height_m) const {
  const double size = options_.tile_size;
  geo::Geodetic place =
      options_.lattice.geodeticFromPlane(geo::TileLattice::planeOf(corner_, x / size, y / size));
  place.height_m = height_m;
  return place;
}

float townHeight(int x, int y) {
  double h = 447 + 3 * std::sin(x * 0.021) * std::cos(y * 0.017) + 0.6 * std::sin(x * 0.13 + y * 0.09);
  const int bx = x >= 0 ? x / 40 : -1, by = y / 40;
  const std::uint32_t n = hash(bx, by);
  const int w = 8 + static_cast<int>(n & 15U), d = 8 + static_cast<int>((n >> 4) & 15U);
  if ((n >> 8) % 3 != 0 && x % 40 >= 6 && x % 40 < 6 + w && y % 40 >= 6 && y % 40 < 6 + d)
    h += 3 + static_cast<double>((n >> 12) & 7U);
  return static_cast<float>(std::round(h * 100) / 100);
}

float holedHeight(int x, int y) {
  const double dx = x - 150, dy = y - 190;
  if (dx * dx + dy * dy < 900 || x < 5 || (x / 60 + y / 60) % 9 == 4) return kNan;
  return townHeight(x, y);
}

}  // namespace overfly::test
