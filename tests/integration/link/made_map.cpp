#include "tests/integration/link/made_map.h"

#include <cmath>
#include <cstdlib>
#include <set>
#include <stdexcept>

#include "tiling/store/tile_codec.h"

namespace overfly::test {
namespace {

template <typename T>
T must(Result<T> result) {
  if (!result) throw std::runtime_error(result.error().message);
  return std::move(*result);
}

tiling::MapMeta metaOf(int zoom, int tile_size) {
  tiling::MapMeta meta;
  meta.id = "";
  meta.name = "Made-up map";
  meta.datum = capture::VerticalDatum::Ellipsoid;
  meta.tile_size = tile_size;
  meta.base_zoom = zoom;
  return meta;
}

}  // namespace

MadeMap::MadeMap(const std::filesystem::path& path, geo::TileKey corner, int side, int tile_size)
    : path_(path),
      meta_(metaOf(corner.zoom, tile_size)),
      store_(must(tiling::MapStore::create(path, meta_))),
      corner_(corner),
      side_(side) {
  meta_ = store_.meta();
}

// Plane coordinates in cells of zoom 0; a wave length of some 40 m at zoom 18's scale.
float MadeMap::heightAt(double x, double y) {
  const double u = x * 6.2832e6, v = y * 6.2832e6;
  return static_cast<float>(120 + 9 * std::sin(u / 3.1) * std::cos(v / 4.3) +
                            4 * std::sin(u / 0.9 + v / 1.3) + 0.8 * std::sin(u * 2.3) * std::sin(v * 2.9));
}

geo::Geodetic MadeMap::centre() const {
  const auto plane = geo::TileLattice::planeOf(corner_, side_ / 2.0, side_ / 2.0);
  return geo::TileLattice::webMercator().geodeticFromPlane(plane);
}

tiling::TileWrite MadeMap::tile(const geo::TileKey& key, int variant) const {
  auto tile = tiling::Tile::blank(key, meta_.tile_size);
  const int size = meta_.tile_size;
  const auto nw = geo::TileLattice::planeOf(corner_), se = geo::TileLattice::planeOf(corner_, side_, side_);
  const double radius = 0.49 * (se.x() - nw.x());
  const Eigen::Vector2d middle = 0.5 * (nw + se);
  for (int j = 0; j < size; ++j)
    for (int i = 0; i < size; ++i) {
      const auto p = geo::TileLattice::planeOf(key, (i + 0.5) / size, (j + 0.5) / size);
      const auto at =
          static_cast<std::size_t>(j) * static_cast<std::size_t>(size) + static_cast<std::size_t>(i);
      const double rim =
          radius * (1 + 0.05 * std::sin(9 * std::atan2(p.y() - middle.y(), p.x() - middle.x())));
      if ((p - middle).norm() > rim) continue;
      const float h = heightAt(p.x(), p.y());
      const double u = p.x() * 6.2832e6, v = p.y() * 6.2832e6;
      const bool path = std::abs(std::sin(u / 2.4 + 0.7 * std::sin(v / 5))) < 0.035;
      const bool row = std::sin(v * 9 + 2 * std::sin(u / 3)) > 0.2;
      const double wood =
          std::sin(u / 1.7) * std::sin(v / 2.1) + 0.35 * std::sin(u * 5.1) * std::sin(v * 4.7);
      double r = row ? 142 : 121, g = row ? 146 : 126, b = row ? 84 : 72;
      if (wood > 0.55) r = 58, g = 88 + 14 * std::sin(u * 31) * std::sin(v * 27), b = 52;
      if (path) r = 196, g = 182, b = 158;
      const double light =
          0.75 + 0.25 * std::tanh((static_cast<double>(h) - 118) / 10) + 0.04 * std::sin(u * 57 + v * 43);
      const double shift = 60.0 * variant;
      tile.color[4 * at + 0] = static_cast<std::uint8_t>(std::clamp(r * light + shift, 0.0, 255.0));
      tile.color[4 * at + 1] = static_cast<std::uint8_t>(std::clamp(g * light, 0.0, 255.0));
      tile.color[4 * at + 2] = static_cast<std::uint8_t>(std::clamp(b * light, 0.0, 255.0));
      tile.color[4 * at + 3] = 255;
      tile.elevation[at] = h;
      tile.confidence[at] =
          static_cast<std::uint8_t>(std::clamp(230 - 180 * (p - middle).norm() / radius, 0.0, 255.0));
      tile.views[at] = 5;
      tile.kind[at] = tiling::kMeasured;
      tile.source[at] = 0;
      tile.gsd[at] = tiling::gsdCode(0.05);
    }
  tile.frame_set = {1};
  return must(tiling::encodeTile(tile, tiling::encodeOptions(meta_)));
}

std::uint64_t MadeMap::make(const std::vector<std::pair<int, int>>& cells, int variant) {
  std::set<geo::TileKey> keys;
  for (const auto& [x, y] : cells) {
    geo::TileKey key{corner_.zoom, corner_.x + x, corner_.y + y};
    const auto top = corner_.zoom - static_cast<int>(std::ceil(std::log2(side_)));
    while (key.zoom >= top) {
      keys.insert(key);
      key = geo::parentOf(key);
    }
  }
  tiling::Batch batch;
  for (const auto& key : keys) batch.tiles.push_back(tile(key, variant));
  return must(store_.commit(batch));
}

std::uint64_t MadeMap::makeAll(int variant) {
  std::vector<std::pair<int, int>> cells;
  for (int y = 0; y < side_; ++y)
    for (int x = 0; x < side_; ++x) cells.emplace_back(x, y);
  return make(cells, variant);
}

std::uint64_t MadeMap::erase(int x, int y) {
  tiling::TileWrite write;
  write.key = {corner_.zoom, corner_.x + x, corner_.y + y};
  write.erase = true;
  tiling::Batch batch;
  batch.tiles.push_back(write);
  return must(store_.commit(batch));
}

void MadeMap::addFrames(int count) {
  tiling::Batch batch;
  const auto lattice = geo::TileLattice::webMercator();
  for (int i = 0; i < count; ++i) {
    // lines from west to east and back, south of each other
    constexpr int kPerLine = 12;
    const auto n = static_cast<int>(next_frame_ - 1);
    const int line = n / kPerLine, step = n % kPerLine;
    const double u = side_ * (0.06 + 0.88 * (line % 2 ? kPerLine - 1 - step : step) / (kPerLine - 1));
    const double v = side_ * (0.12 + 0.15 * line);
    const auto corner = [&](double du, double dv) {
      auto g = lattice.geodeticFromPlane(geo::TileLattice::planeOf(corner_, u + du, v + dv));
      g.height_m = 120;
      return g;
    };
    tiling::FrameRecord frame;
    frame.id = next_frame_++;
    frame.name = "frame " + std::to_string(frame.id);
    frame.state = tiling::FrameState::Mapped;
    frame.time_ns = n * std::int64_t{2000000000};
    frame.utc_offset_ns = std::int64_t{1760000000} * 1000000000;
    capture::Pose pose;
    auto position = corner(0, 0);
    position.height_m = 200;
    pose.position_in_ecef = geo::ecefFromGeodetic(position);
    frame.pose = pose;
    geo::Footprint footprint;
    const double w = 0.16 * side_, h = 0.12 * side_;
    footprint.corners = {corner(-w, -h), corner(w, -h), corner(w, h), corner(-w, h)};
    footprint.centre = corner(0, 0);
    footprint.gsd_m = 0.05;
    frame.footprint = footprint;
    batch.frames.push_back(frame);
  }
  must(store_.commit(batch));
}

}  // namespace overfly::test
