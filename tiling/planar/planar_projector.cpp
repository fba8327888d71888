#include "tiling/planar/planar_projector.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "capture/geo/tile_frame.h"

namespace overfly::tiling {
namespace {

constexpr std::int64_t kHalfPixel = 32768;
constexpr std::size_t kBlockTexels = std::size_t{PlanarPlan::kBlock} * PlanarPlan::kBlock;
constexpr float kNowhere = std::numeric_limits<float>::quiet_NaN();

// Four channels of one pixel, or of two side by side.
using Channels = std::uint16_t __attribute__((vector_size(8)));
using Bytes4 = std::uint8_t __attribute__((vector_size(4)));

inline Channels channelsOf(std::uint32_t pixel) {
  return __builtin_convertvector(std::bit_cast<Bytes4>(pixel), Channels);
}

inline Channels mix(Channels a, Channels b, std::uint16_t f) {
  return (a * static_cast<std::uint16_t>(256 - f) + b * f + 128) >> 8;
}

// Bilinear value of four pixels; weights of 8 bits.
inline std::uint32_t mixFour(const std::uint32_t* above, const std::uint32_t* below, std::size_t right,
                             std::int64_t x, std::int64_t y) {
  const auto fx = static_cast<std::uint16_t>((x >> 8) & 255), fy = static_cast<std::uint16_t>((y >> 8) & 255);
  const Channels left_column = mix(channelsOf(above[0]), channelsOf(below[0]), fy);
  const Channels right_column = mix(channelsOf(above[right]), channelsOf(below[right]), fy);
  return std::bit_cast<std::uint32_t>(__builtin_convertvector(mix(left_column, right_column, fx), Bytes4));
}

// Bilinear read at a pixel coordinate (first pixel's centre at 0.5, 0.5) given in 1/65536, clamped at the
// rim.
inline std::uint32_t sample(const PlanarImage& image, std::int64_t x16, std::int64_t y16) {
  const std::int64_t x = std::clamp<std::int64_t>(x16 - kHalfPixel, 0, std::int64_t{image.width - 1} << 16);
  const std::int64_t y = std::clamp<std::int64_t>(y16 - kHalfPixel, 0, std::int64_t{image.height - 1} << 16);
  const auto ix = static_cast<std::size_t>(x >> 16), iy = static_cast<std::size_t>(y >> 16);
  const auto width = static_cast<std::size_t>(image.width);
  const std::size_t right = ix + 1 < width ? 1 : 0;
  const std::size_t below = iy + 1 < static_cast<std::size_t>(image.height) ? width : 0;
  const auto* pixels = reinterpret_cast<const std::uint32_t*>(image.rgbx.data()) + iy * width + ix;
  return mixFour(pixels, pixels + below, right, x, y);
}

// The same without clamping: the pixel and its right and lower neighbours are in the image.
inline std::uint32_t sampleInside(const std::uint32_t* pixels, std::size_t width, std::int64_t x16,
                                  std::int64_t y16) {
  const std::int64_t x = x16 - kHalfPixel, y = y16 - kHalfPixel;
  const std::uint32_t* at =
      pixels + static_cast<std::size_t>(y >> 16) * width + static_cast<std::size_t>(x >> 16);
  return mixFour(at, at + width, 1, x, y);
}

// Of what decides a block: ids, folded in ascending order. Never 0.
std::uint64_t markOf(std::uint64_t mark, std::uint64_t id) {
  std::uint64_t h = mark ^ (id + 0x9E3779B97F4A7C15ULL);
  h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9ULL;
  h = (h ^ (h >> 27)) * 0x94D049BB133111EBULL;
  return (h ^ (h >> 31)) | 1;
}
// Place in a frame set of a frame that has left it.
constexpr std::uint16_t kGone = Tile::kNoSource - 1;
constexpr std::uint64_t kMixedMark = 0x5DEECE66DULL;  // so that a mixed block of one frame is not a whole one

float bilinear(const float corners[4], float s, float t) {
  return (1 - t) * ((1 - s) * corners[0] + s * corners[1]) + t * ((1 - s) * corners[2] + s * corners[3]);
}

}  // namespace

struct PlanarPlan::Place {
  std::size_t first = 0;  // texel
  std::size_t nodes[4];   // corners: north-west, north-east, south-west, south-east
};

PlanarPlan::Place PlanarPlan::placeOf(std::size_t block) const {
  const auto blocks = static_cast<std::size_t>(blocks_), side = blocks + 1;
  const std::size_t row = block / blocks, column = block % blocks, corner = row * side + column;
  return {(row * static_cast<std::size_t>(size_) + column) * kBlock,
          {corner, corner + 1, corner + side, corner + side + 1}};
}

// Where the texels of a block's rows lie in a picture: on straight lines, evenly, in 1/65536 pixel.
class PlanarPlan::Lines {
 public:
  Lines(const View& view, const PlanarImage& image, const Place& place) {
    const double to_image_x = static_cast<double>(image.width) / view.width * 65536;
    const double to_image_y = static_cast<double>(image.height) / view.height * 65536;
    for (int i = 0; i < 4; ++i) {
      corner_x_[i] = static_cast<double>(view.x[place.nodes[i]]) * to_image_x;
      corner_y_[i] = static_cast<double>(view.y[place.nodes[i]]) * to_image_y;
    }
  }
  void toRow(int row) {
    const double t = (row + 0.5) / kBlock;
    const double x0 = corner_x_[0] + t * (corner_x_[2] - corner_x_[0]);
    const double x1 = corner_x_[1] + t * (corner_x_[3] - corner_x_[1]);
    const double y0 = corner_y_[0] + t * (corner_y_[2] - corner_y_[0]);
    const double y1 = corner_y_[1] + t * (corner_y_[3] - corner_y_[1]);
    step_x = std::llround((x1 - x0) / kBlock);
    step_y = std::llround((y1 - y0) / kBlock);
    x = std::llround(x0) + step_x / 2;
    y = std::llround(y0) + step_y / 2;
  }
  std::int64_t x = 0, y = 0;            // of the row's first texel
  std::int64_t step_x = 0, step_y = 0;  // from texel to texel

 private:
  double corner_x_[4], corner_y_[4];
};

bool PlanarPlan::holds(const View& view, float x, float y) const {
  return x >= 0 && y >= 0 && x <= static_cast<float>(view.width) && y <= static_cast<float>(view.height);
}

// Whether some pixel of the picture may lie in the block.
bool PlanarPlan::reaches(const View& view, const Place& place) const {
  float x0 = std::numeric_limits<float>::max(), x1 = -x0, y0 = x0, y1 = -x0;
  for (const std::size_t node : place.nodes) {
    x0 = std::min(x0, view.x[node]);
    x1 = std::max(x1, view.x[node]);
    y0 = std::min(y0, view.y[node]);
    y1 = std::max(y1, view.y[node]);
  }
  return x1 >= 0 && y1 >= 0 && x0 <= static_cast<float>(view.width) && y0 <= static_cast<float>(view.height);
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
  const auto blocks = static_cast<std::size_t>(blocks_) * static_cast<std::size_t>(blocks_);
  for (std::size_t block = 0; block < blocks; ++block) {
    const Place place = placeOf(block);
    const int first = at_node[place.nodes[0]];
    const bool agree = std::all_of(std::begin(place.nodes), std::end(place.nodes),
                                   [&](std::size_t n) { return at_node[n] == first; });
    if (agree && first != kNone) {
      winner_.push_back(first);
      marks_.push_back(markOf(0, ids_[static_cast<std::size_t>(first)]));
      needed[static_cast<std::size_t>(first)] = true;
      continue;
    }
    // Every frame whose picture reaches into the block's box of pixels may give some of its texels.
    bool mixed = false;
    std::uint64_t mark = kMixedMark;
    for (std::size_t k = 0; k < views_.size(); ++k) {
      if (!reaches(views_[k], place)) continue;
      mixed = needed[k] = true;
      mark = markOf(mark, ids_[k]);
    }
    marks_.push_back(mixed ? mark : 0);
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
  const std::uint8_t gsd = gsdCode(view.gsd_m);
  const auto* pixels = reinterpret_cast<const std::uint32_t*>(image.rgbx.data());
  const auto width = static_cast<std::size_t>(image.width);
  const std::int64_t right = (std::int64_t{image.width - 1} << 16) + kHalfPixel;
  const std::int64_t bottom = (std::int64_t{image.height - 1} << 16) + kHalfPixel;
  const auto inside = [&](std::int64_t x16, std::int64_t y16) {
    return x16 >= kHalfPixel && y16 >= kHalfPixel && x16 < right && y16 < bottom;
  };
  Lines line(view, image, place);
  for (int row = 0; row < kBlock; ++row) {
    line.toRow(row);
    const std::size_t begin = place.first + static_cast<std::size_t>(row) * static_cast<std::size_t>(size_);
    auto* out = reinterpret_cast<std::uint32_t*>(tile.color.data()) + begin;
    // When both ends are inside, all between them are.
    if (inside(line.x, line.y) &&
        inside(line.x + (kBlock - 1) * line.step_x, line.y + (kBlock - 1) * line.step_y))
      for (int column = 0; column < kBlock; ++column, line.x += line.step_x, line.y += line.step_y)
        out[column] = sampleInside(pixels, width, line.x, line.y) | 0xff000000U;
    else
      for (int column = 0; column < kBlock; ++column, line.x += line.step_x, line.y += line.step_y)
        out[column] = sample(image, line.x, line.y) | 0xff000000U;
    const auto at = static_cast<std::ptrdiff_t>(begin);
    std::fill_n(tile.source.begin() + at, kBlock, static_cast<std::uint16_t>(view_index));
    std::fill_n(tile.gsd.begin() + at, kBlock, gsd);
    std::fill_n(tile.kind.begin() + at, kBlock, std::uint8_t{kProvisional});
  }
}

// The frame of each texel of a block that several share, row by row.
void PlanarPlan::chooseTexels(const Place& place, std::uint16_t* source) const {
  struct Candidate {
    std::size_t view;
    float x[4], y[4], away[4];
  };
  std::vector<Candidate> candidates;
  for (std::size_t k = 0; k < views_.size(); ++k) {
    const View& view = views_[k];
    if (!reaches(view, place)) continue;
    Candidate candidate{k, {}, {}, {}};
    for (std::size_t i = 0; i < 4; ++i) {
      candidate.x[i] = view.x[place.nodes[i]];
      candidate.y[i] = view.y[place.nodes[i]];
      candidate.away[i] = view.away[place.nodes[i]];
    }
    candidates.push_back(candidate);
  }
  for (int row = 0; row < kBlock; ++row)
    for (int column = 0; column < kBlock; ++column, ++source) {
      const float s = (static_cast<float>(column) + 0.5f) / kBlock;
      const float t = (static_cast<float>(row) + 0.5f) / kBlock;
      float best_away = 0;
      *source = Tile::kNoSource;
      for (const Candidate& candidate : candidates) {
        const float away = bilinear(candidate.away, s, t);
        if (*source != Tile::kNoSource && away >= best_away) continue;
        if (!holds(views_[candidate.view], bilinear(candidate.x, s, t), bilinear(candidate.y, s, t)))
          continue;
        *source = static_cast<std::uint16_t>(candidate.view);
        best_away = away;
      }
    }
}

// The texels of a block that several frames share which are to come from frame k and do not yet.
bool PlanarPlan::mixBlock(const Place& place, const std::uint16_t* source, std::size_t k,
                          const PlanarImage& image, Tile& tile) const {
  if (!reaches(views_[k], place)) return false;
  auto* color = reinterpret_cast<std::uint32_t*>(tile.color.data());
  const std::uint8_t gsd = gsdCode(views_[k].gsd_m);
  bool any = false;
  Lines line(views_[k], image, place);
  for (int row = 0; row < kBlock; ++row) {
    line.toRow(row);
    const std::size_t begin = place.first + static_cast<std::size_t>(row) * static_cast<std::size_t>(size_);
    const std::uint16_t* chosen = source + row * kBlock;
    for (int column = 0; column < kBlock; ++column) {
      const std::size_t at = begin + static_cast<std::size_t>(column);
      if (chosen[column] != k || tile.source[at] == k) continue;
      color[at] = sample(image, line.x + column * line.step_x, line.y + column * line.step_y) | 0xff000000U;
      tile.source[at] = static_cast<std::uint16_t>(k);
      tile.gsd[at] = gsd;
      tile.kind[at] = kProvisional;
      any = true;
    }
  }
  return any;
}

Tile PlanarPlan::blank(Tile&& reuse) const {
  Tile tile = std::move(reuse);
  tile.key = key_;
  tile.size = size_;
  tile.frame_set.clear();
  const std::size_t n = tile.texels();
  tile.color.assign(4 * n, 0);
  tile.kind.assign(n, kNoData);
  tile.source.assign(n, Tile::kNoSource);
  tile.gsd.assign(n, 0);
  return tile;
}

Tile PlanarPlan::render(std::span<const PlanarImagePtr> images) const {
  Tile tile = blank();
  Marks marks = noMarks();
  const Changes changes = prepare(tile, marks);
  for (std::size_t k = 0; k < images.size(); ++k)
    if (changes.needed[k]) draw(changes, k, *images[k], marks, tile);
  finish(changes, tile, marks);
  return tile;
}

PlanarPlan::Changes PlanarPlan::prepare(Tile& tile, const Marks& marks) const {
  if (tile.frame_set != ids_) {
    // Sources are places in the frame set.
    std::vector<std::uint16_t> place(tile.frame_set.size(), kGone);
    bool moves = false;
    for (std::size_t k = 0; k < place.size(); ++k) {
      const auto found = std::lower_bound(ids_.begin(), ids_.end(), tile.frame_set[k]);
      if (found != ids_.end() && *found == tile.frame_set[k])
        place[k] = static_cast<std::uint16_t>(found - ids_.begin());
      moves = moves || place[k] != k;
    }
    if (moves)
      for (std::uint16_t& source : tile.source)  // kGone: an earlier plan's pictures could not be had
        if (source < place.size()) source = place[source];
    tile.frame_set = ids_;
  }
  Changes changes{std::vector<bool>(views_.size(), false), {}};
  for (std::size_t block = 0; block < winner_.size(); ++block) {
    if (marks[block] == marks_[block]) continue;
    const Place place = placeOf(block);
    if (winner_[block] >= 0) {
      changes.needed[static_cast<std::size_t>(winner_[block])] = true;
      continue;
    }
    const std::size_t begin = changes.source.size();
    changes.source.resize(begin + kBlockTexels, Tile::kNoSource);
    if (winner_[block] == kMixed) chooseTexels(place, changes.source.data() + begin);
    for (std::size_t i = 0; i < kBlockTexels; ++i) {
      const std::uint16_t source = changes.source[begin + i];
      const std::size_t at = place.first + i / kBlock * static_cast<std::size_t>(size_) + i % kBlock;
      if (source != Tile::kNoSource && source != tile.source[at]) changes.needed[source] = true;
    }
  }
  return changes;
}

bool PlanarPlan::draw(const Changes& changes, std::size_t k, const PlanarImage& image, const Marks& marks,
                      Tile& tile) const {
  const std::uint16_t* source = changes.source.data();
  bool any = false;
  for (std::size_t block = 0; block < winner_.size(); ++block) {
    if (marks[block] == marks_[block]) continue;
    const int winner = winner_[block];
    if (winner < 0) {
      any = mixBlock(placeOf(block), source, k, image, tile) || any;
      source += kBlockTexels;
    } else if (static_cast<std::size_t>(winner) == k) {
      copyBlock(placeOf(block), winner, image, tile);
      any = true;
    }
  }
  return any;
}

void PlanarPlan::finish(const Changes& changes, Tile& tile, Marks& marks) const {
  auto* color = reinterpret_cast<std::uint32_t*>(tile.color.data());
  const std::uint16_t* source = changes.source.data();
  for (std::size_t block = 0; block < winner_.size(); ++block) {
    if (marks[block] == marks_[block] || winner_[block] >= 0) continue;
    const Place place = placeOf(block);
    // A frame that is no longer there may have been the only one.
    for (std::size_t i = 0; i < kBlockTexels; ++i, ++source) {
      const std::size_t at = place.first + i / kBlock * static_cast<std::size_t>(size_) + i % kBlock;
      if (*source != Tile::kNoSource || tile.source[at] == Tile::kNoSource) continue;
      color[at] = 0;
      tile.source[at] = Tile::kNoSource;
      tile.gsd[at] = 0;
      tile.kind[at] = kNoData;
    }
  }
  marks = marks_;
}

}  // namespace overfly::tiling
