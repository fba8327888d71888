#include "tiling/planar/planar_projector.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "capture/geo/tile_frame.h"

namespace overfly::tiling {
namespace {

constexpr float kNowhere = std::numeric_limits<float>::quiet_NaN();

// Bilinear read at a pixel coordinate (first pixel's centre at 0.5, 0.5) given in 1/65536, clamped at the
// rim. Weights of 8 bits; two channels at a time in one word.
inline std::uint32_t sample(const PlanarImage& image, std::int64_t x16, std::int64_t y16) {
  const std::int64_t x = std::clamp<std::int64_t>(x16 - 32768, 0, std::int64_t{image.width - 1} << 16);
  const std::int64_t y = std::clamp<std::int64_t>(y16 - 32768, 0, std::int64_t{image.height - 1} << 16);
  const auto ix = static_cast<std::size_t>(x >> 16), iy = static_cast<std::size_t>(y >> 16);
  const auto width = static_cast<std::size_t>(image.width);
  const std::size_t right = ix + 1 < width ? 1 : 0;
  const std::size_t below = iy + 1 < static_cast<std::size_t>(image.height) ? width : 0;
  const auto* pixels = reinterpret_cast<const std::uint32_t*>(image.rgbx.data()) + iy * width + ix;
  const auto fx = static_cast<std::uint32_t>(x >> 8) & 255U, fy = static_cast<std::uint32_t>(y >> 8) & 255U;
  const auto mix = [](std::uint32_t a, std::uint32_t b, std::uint32_t f) {
    const std::uint32_t low = (a & 0xff00ffU) * (256 - f) + (b & 0xff00ffU) * f + 0x800080U;
    const std::uint32_t high = ((a >> 8) & 0xff00ffU) * (256 - f) + ((b >> 8) & 0xff00ffU) * f + 0x800080U;
    return ((low >> 8) & 0xff00ffU) | (high & 0xff00ff00U);
  };
  return mix(mix(pixels[0], pixels[right], fx), mix(pixels[below], pixels[below + right], fx), fy);
}

float bilinear(const float corners[4], float s, float t) {
  return (1 - t) * ((1 - s) * corners[0] + s * corners[1]) + t * ((1 - s) * corners[2] + s * corners[3]);
}

}  // namespace

struct PlanarPlan::Place {
  int column = 0, row = 0;  // of its first texel
  std::size_t nodes[4];     // corners: north-west, north-east, south-west, south-east
};

bool PlanarPlan::holds(const View& view, float x, float y) const {
  return x >= 0 && y >= 0 && x <= static_cast<float>(view.width) && y <= static_cast<float>(view.height);
}

int PlanarPlan::winnerAt(std::size_t node) const {
  int best = kNone;
  for (std::size_t k = 0; k < views_.size(); ++k) {
    const View& view = views_[k];
    if (!holds(view, view.x[node], view.y[node])) continue;
    if (best == kNone || view.away[node] < views_[static_cast<std::size_t>(best)].away[node])
      best = static_cast<int>(k);
  }
  return best;
}

PlanarPlan::PlanarPlan(const geo::TileLattice& lattice, const geo::TileKey& key, int size, double height_m,
                       std::span<const IndexedFrame* const> candidates)
    : key_(key), size_(size), blocks_(size / kBlock) {
  const geo::TileFrame frame(lattice, key);
  const auto side = static_cast<std::size_t>(blocks_ + 1);
  std::vector<Eigen::Vector3d> places;
  places.reserve(side * side);
  for (std::size_t j = 0; j < side; ++j)
    for (std::size_t i = 0; i < side; ++i)
      places.push_back(
          frame.enuFromTexel(static_cast<double>(i) / blocks_, static_cast<double>(j) / blocks_, height_m));
  const Eigen::Quaterniond enu_from_ecef(frame.local().enuFromEcefRotation());
  for (const IndexedFrame* candidate : candidates) {
    const Eigen::Matrix3d camera_from_tile =
        (enu_from_ecef * candidate->pose.ecef_from_camera).conjugate().toRotationMatrix();
    const Eigen::Vector3d eye = frame.local().enuFromEcef(candidate->pose.position_in_ecef);
    const double above = std::max(candidate->camera_height_m - height_m, 0.1);
    View view{candidate->gsd_m, candidate->camera.width, candidate->camera.height, {}, {}, {}};
    bool any = false;
    for (const Eigen::Vector3d& place : places) {
      const Eigen::Vector3d ray = place - eye;
      const auto pixel = candidate->camera.project(camera_from_tile * ray);
      view.x.push_back(pixel ? static_cast<float>(pixel->x()) : kNowhere);
      view.y.push_back(pixel ? static_cast<float>(pixel->y()) : kNowhere);
      view.away.push_back(static_cast<float>(ray.head<2>().squaredNorm() / (above * above)));
      any = any || pixel.has_value();
    }
    if (!any) continue;
    views_.push_back(std::move(view));
    ids_.push_back(candidate->id);
  }

  std::vector<int> at_node(side * side);
  for (std::size_t node = 0; node < at_node.size(); ++node) at_node[node] = winnerAt(node);
  std::vector<bool> needed(views_.size(), false);
  for (std::size_t j = 0; j + 1 < side; ++j)
    for (std::size_t i = 0; i + 1 < side; ++i) {
      const std::size_t nodes[4] = {j * side + i, j * side + i + 1, (j + 1) * side + i,
                                    (j + 1) * side + i + 1};
      const int first = at_node[nodes[0]];
      const bool agree = std::all_of(nodes, nodes + 4, [&](std::size_t n) { return at_node[n] == first; });
      if (agree && first != kNone) {
        winner_.push_back(first);
        needed[static_cast<std::size_t>(first)] = true;
        continue;
      }
      // Every frame whose picture reaches into the block's box of pixels may give some of its texels.
      bool mixed = false;
      for (std::size_t k = 0; k < views_.size(); ++k) {
        float x0 = std::numeric_limits<float>::max(), x1 = -x0, y0 = x0, y1 = -x0;
        for (const std::size_t node : nodes) {
          x0 = std::min(x0, views_[k].x[node]);
          x1 = std::max(x1, views_[k].x[node]);
          y0 = std::min(y0, views_[k].y[node]);
          y1 = std::max(y1, views_[k].y[node]);
        }
        if (!(x1 >= 0 && y1 >= 0 && x0 <= static_cast<float>(views_[k].width) &&
              y0 <= static_cast<float>(views_[k].height)))
          continue;
        mixed = needed[k] = true;
      }
      winner_.push_back(mixed ? kMixed : kNone);
    }

  // Only what is needed is kept: indices move down.
  std::vector<int> index(views_.size(), kNone);
  std::size_t kept = 0;
  for (std::size_t k = 0; k < views_.size(); ++k) {
    if (!needed[k]) continue;
    index[k] = static_cast<int>(kept);
    if (k != kept) {
      views_[kept] = std::move(views_[k]);
      ids_[kept] = ids_[k];
    }
    ++kept;
  }
  views_.resize(kept);
  ids_.resize(kept);
  for (int& winner : winner_)
    if (winner >= 0) winner = index[static_cast<std::size_t>(winner)];
}

void PlanarPlan::copyBlock(const Place& place, int view_index, const PlanarImage& image, Tile& tile) const {
  const View& view = views_[static_cast<std::size_t>(view_index)];
  const double to_image_x = static_cast<double>(image.width) / view.width * 65536;
  const double to_image_y = static_cast<double>(image.height) / view.height * 65536;
  double x[4], y[4];
  for (int i = 0; i < 4; ++i) {
    x[i] = static_cast<double>(view.x[place.nodes[i]]) * to_image_x;
    y[i] = static_cast<double>(view.y[place.nodes[i]]) * to_image_y;
  }
  const std::uint8_t gsd = gsdCode(view.gsd_m);
  for (int row = 0; row < kBlock; ++row) {
    const double t = (row + 0.5) / kBlock;
    const double x0 = x[0] + t * (x[2] - x[0]), x1 = x[1] + t * (x[3] - x[1]);
    const double y0 = y[0] + t * (y[2] - y[0]), y1 = y[1] + t * (y[3] - y[1]);
    const auto step_x = std::llround((x1 - x0) / kBlock), step_y = std::llround((y1 - y0) / kBlock);
    std::int64_t px = std::llround(x0) + step_x / 2, py = std::llround(y0) + step_y / 2;
    const std::size_t begin = static_cast<std::size_t>(place.row + row) * static_cast<std::size_t>(size_) +
                              static_cast<std::size_t>(place.column);
    auto* out = reinterpret_cast<std::uint32_t*>(tile.color.data()) + begin;
    for (int column = 0; column < kBlock; ++column, px += step_x, py += step_y)
      out[column] = sample(image, px, py) | 0xff000000U;
    std::fill_n(tile.source.begin() + static_cast<std::ptrdiff_t>(begin), kBlock,
                static_cast<std::uint16_t>(view_index));
    std::fill_n(tile.gsd.begin() + static_cast<std::ptrdiff_t>(begin), kBlock, gsd);
    std::fill_n(tile.kind.begin() + static_cast<std::ptrdiff_t>(begin), kBlock, std::uint8_t{kProvisional});
  }
}

void PlanarPlan::mixBlock(const Place& place, std::span<const PlanarImagePtr> images, Tile& tile) const {
  struct Corners {
    std::size_t view;
    float x[4], y[4], away[4];
  };
  std::vector<Corners> candidates;
  for (std::size_t k = 0; k < views_.size(); ++k) {
    Corners corners{k, {}, {}, {}};
    for (std::size_t i = 0; i < 4; ++i) {
      corners.x[i] = views_[k].x[place.nodes[i]];
      corners.y[i] = views_[k].y[place.nodes[i]];
      corners.away[i] = views_[k].away[place.nodes[i]];
    }
    candidates.push_back(corners);
  }
  for (int row = 0; row < kBlock; ++row)
    for (int column = 0; column < kBlock; ++column) {
      const float s = (static_cast<float>(column) + 0.5f) / kBlock;
      const float t = (static_cast<float>(row) + 0.5f) / kBlock;
      const Corners* best = nullptr;
      float best_away = 0, best_x = 0, best_y = 0;
      for (const Corners& candidate : candidates) {
        const float away = bilinear(candidate.away, s, t);
        if (best != nullptr && away >= best_away) continue;
        const float x = bilinear(candidate.x, s, t), y = bilinear(candidate.y, s, t);
        if (!holds(views_[candidate.view], x, y)) continue;
        best = &candidate;
        best_away = away;
        best_x = x;
        best_y = y;
      }
      if (best == nullptr) continue;
      const View& view = views_[best->view];
      const PlanarImage& image = *images[best->view];
      const std::size_t at = static_cast<std::size_t>(place.row + row) * static_cast<std::size_t>(size_) +
                             static_cast<std::size_t>(place.column + column);
      reinterpret_cast<std::uint32_t*>(tile.color.data())[at] =
          sample(image, std::llround(static_cast<double>(best_x) * image.width / view.width * 65536),
                 std::llround(static_cast<double>(best_y) * image.height / view.height * 65536)) |
          0xff000000U;
      tile.source[at] = static_cast<std::uint16_t>(best->view);
      tile.gsd[at] = gsdCode(view.gsd_m);
      tile.kind[at] = kProvisional;
    }
}

Tile PlanarPlan::render(std::span<const PlanarImagePtr> images) const {
  Tile tile;
  tile.key = key_;
  tile.size = size_;
  const std::size_t n = tile.texels();
  tile.color.assign(4 * n, 0);
  tile.kind.assign(n, kNoData);
  tile.source.assign(n, Tile::kNoSource);
  tile.gsd.assign(n, 0);
  tile.frame_set = ids_;
  const auto side = static_cast<std::size_t>(blocks_ + 1);
  std::size_t block = 0;
  for (int j = 0; j < blocks_; ++j)
    for (int i = 0; i < blocks_; ++i, ++block) {
      const int winner = winner_[block];
      if (winner == kNone) continue;
      const std::size_t corner = static_cast<std::size_t>(j) * side + static_cast<std::size_t>(i);
      const Place place{i * kBlock, j * kBlock, {corner, corner + 1, corner + side, corner + side + 1}};
      if (winner == kMixed)
        mixBlock(place, images, tile);
      else
        copyBlock(place, winner, *images[static_cast<std::size_t>(winner)], tile);
    }
  return tile;
}

}  // namespace overfly::tiling
