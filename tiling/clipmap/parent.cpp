#include "tiling/clipmap/parent.h"

#include <cmath>

namespace overfly::tiling {
namespace {

using Index = std::size_t;

// Walks the parent's texels beneath one child: at(parent texel, the child's four texels).
template <typename At>
void forQuadrant(int size, int child, At at) {
  const Index n = static_cast<Index>(size), half = n / 2;
  const Index column0 = (child & 1) != 0 ? half : 0, row0 = (child & 2) != 0 ? half : 0;
  for (Index row = 0; row < half; ++row)
    for (Index column = 0; column < half; ++column) {
      const Index first = 2 * row * n + 2 * column;
      at((row0 + row) * n + column0 + column,
         std::array<Index, 4>{first, first + 1, first + n, first + n + 1});
    }
}

void averageColor(const Tile& child, int quadrant, Tile& parent) {
  forQuadrant(parent.size, quadrant, [&](Index out, const std::array<Index, 4>& in) {
    unsigned sum[4] = {0, 0, 0, 0}, count = 0;
    for (const Index i : in) {
      if (child.color[4 * i + 3] == 0) continue;
      ++count;
      for (Index c = 0; c < 4; ++c) sum[c] += child.color[4 * i + c];
    }
    if (count == 0) return;
    for (Index c = 0; c < 4; ++c)
      parent.color[4 * out + c] = static_cast<std::uint8_t>((sum[c] + count / 2) / count);
  });
}

void averageElevation(const Tile& child, int quadrant, Tile& parent) {
  forQuadrant(parent.size, quadrant, [&](Index out, const std::array<Index, 4>& in) {
    double sum = 0;
    int count = 0;
    for (const Index i : in) {
      if (std::isnan(child.elevation[i])) continue;
      sum += static_cast<double>(child.elevation[i]);
      ++count;
    }
    if (count > 0) parent.elevation[out] = static_cast<float>(sum / count);
  });
}

void averageBytes(const std::vector<std::uint8_t>& child, int size, int quadrant,
                  std::vector<std::uint8_t>& parent) {
  forQuadrant(size, quadrant, [&](Index out, const std::array<Index, 4>& in) {
    unsigned sum = 0, count = 0;
    for (const Index i : in) {
      sum += child[i];
      count += child[i] != 0 ? 1U : 0U;
    }
    if (count > 0) parent[out] = static_cast<std::uint8_t>((sum + count / 2) / count);
  });
}

}  // namespace

Tile makeParent(const geo::TileKey& key, const std::array<const Tile*, 4>& children) {
  Tile parent;
  parent.key = key;
  for (const Tile* child : children)
    if (child != nullptr) parent.size = child->size;
  const Index n = parent.texels();
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  for (int q = 0; q < 4; ++q) {
    const Tile* child = children[static_cast<Index>(q)];
    if (child == nullptr) continue;
    if (!child->color.empty()) {
      parent.color.resize(4 * n, 0);
      averageColor(*child, q, parent);
    }
    if (!child->elevation.empty()) {
      parent.elevation.resize(n, kNan);
      averageElevation(*child, q, parent);
    }
    const auto bytes = [&](const std::vector<std::uint8_t>& in, std::vector<std::uint8_t>& out) {
      if (in.empty()) return;
      out.resize(n, 0);
      averageBytes(in, parent.size, q, out);
    };
    bytes(child->confidence, parent.confidence);
    bytes(child->views, parent.views);
    bytes(child->gsd, parent.gsd);
    bytes(child->angle, parent.angle);
    if (!child->kind.empty()) {
      parent.kind.resize(n, kNoData);
      forQuadrant(parent.size, q, [&](Index out, const std::array<Index, 4>& in) {
        for (const Index i : in)
          parent.kind[out] = static_cast<std::uint8_t>(parent.kind[out] | child->kind[i]);
      });
    }
  }
  if (parent.elevation.empty()) return parent;
  std::vector<float> bound = elevationMax(parent);
  for (int q = 0; q < 4; ++q) {
    const Tile* child = children[static_cast<Index>(q)];
    if (child == nullptr || child->elevation.empty()) continue;
    const std::vector<float> finer = elevationMax(*child);
    forQuadrant(parent.size, q, [&](Index out, const std::array<Index, 4>& in) {
      for (const Index i : in) bound[out] = std::fmax(bound[out], finer[i]);
    });
  }
  parent.elevation_max = std::move(bound);
  return parent;
}

}  // namespace overfly::tiling
