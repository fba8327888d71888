#include "tiling/clipmap/parent.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>

namespace overfly::tiling {
namespace {

using Index = std::size_t;

// Where the texels that are made of one child lie: a quadrant of the parent, or a picture of their own.
struct Target {
  Index first = 0, stride = 0;
};

Target quadrantOf(int size, int child) {
  const Index n = static_cast<Index>(size), half = n / 2;
  return {((child & 2) != 0 ? half * n : 0) + ((child & 1) != 0 ? half : 0), n};
}

// Walks the target's texels: at(its texel, the child's four texels). `size`: the child's.
template <typename At>
void forCells(int size, const Target& target, At at) {
  const Index n = static_cast<Index>(size), half = n / 2;
  for (Index row = 0; row < half; ++row)
    for (Index column = 0; column < half; ++column) {
      const Index first = 2 * row * n + 2 * column;
      at(target.first + row * target.stride + column,
         std::array<Index, 4>{first, first + 1, first + n, first + n + 1});
    }
}

void averageColor(const Tile& child, const Target& target, std::vector<std::uint8_t>& color) {
  forCells(child.size, target, [&](Index out, const std::array<Index, 4>& in) {
    std::uint32_t words[4];
    for (Index k = 0; k < 4; ++k) std::memcpy(&words[k], child.color.data() + 4 * in[k], 4);
    std::uint8_t alpha = 255;
    for (const Index i : in) alpha &= child.color[4 * i + 3];
    if (alpha == 255) {  // two channels at a time in one word
      constexpr std::uint32_t kMask = 0xff00ffU, kHalf = 0x20002U;
      std::uint32_t even = kHalf, odd = kHalf;
      for (const std::uint32_t word : words) {
        even += word & kMask;
        odd += (word >> 8) & kMask;
      }
      const std::uint32_t mean = ((even >> 2) & kMask) | (((odd >> 2) & kMask) << 8);
      std::memcpy(color.data() + 4 * out, &mean, 4);
      return;
    }
    unsigned sum[4] = {0, 0, 0, 0}, count = 0;
    for (const Index i : in) {
      if (child.color[4 * i + 3] == 0) continue;
      ++count;
      for (Index c = 0; c < 4; ++c) sum[c] += child.color[4 * i + c];
    }
    if (count == 0) return;
    for (Index c = 0; c < 4; ++c)
      color[4 * out + c] = static_cast<std::uint8_t>((sum[c] + count / 2) / count);
  });
}

void averageElevation(const Tile& child, int quadrant, Tile& parent) {
  forCells(parent.size, quadrantOf(parent.size, quadrant), [&](Index out, const std::array<Index, 4>& in) {
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

void averageBytes(const std::vector<std::uint8_t>& child, int size, const Target& target,
                  std::vector<std::uint8_t>& parent) {
  forCells(size, target, [&](Index out, const std::array<Index, 4>& in) {
    const std::uint8_t first = child[in[0]];
    if (first == child[in[1]] && first == child[in[2]] && first == child[in[3]]) {
      parent[out] = first;
      return;
    }
    unsigned sum = 0, count = 0;
    for (const Index i : in) {
      sum += child[i];
      count += child[i] != 0 ? 1U : 0U;
    }
    parent[out] = static_cast<std::uint8_t>((sum + count / 2) / count);
  });
}

// As default-constructed, in the memory that it has.
Tile emptied(Tile&& tile) {
  Tile empty = std::move(tile);
  empty.key = {};
  empty.size = 0;
  for (auto* layer : {&empty.color, &empty.confidence, &empty.views, &empty.kind, &empty.gsd, &empty.angle})
    layer->clear();
  empty.elevation.clear();
  empty.elevation_max.clear();
  empty.source.clear();
  empty.frame_set.clear();
  return empty;
}

// Everything but the heights, for `texels` texels in all.
void averageLayers(const Tile& child, const Target& target, Index texels, Tile& out) {
  if (!child.color.empty()) {
    out.color.resize(4 * texels, 0);
    averageColor(child, target, out.color);
  }
  const auto bytes = [&](const std::vector<std::uint8_t>& from, std::vector<std::uint8_t>& to) {
    if (from.empty()) return;
    to.resize(texels, 0);
    averageBytes(from, child.size, target, to);
  };
  bytes(child.confidence, out.confidence);
  bytes(child.views, out.views);
  bytes(child.gsd, out.gsd);
  bytes(child.angle, out.angle);
  if (child.kind.empty()) return;
  out.kind.resize(texels, kNoData);
  forCells(child.size, target, [&](Index at, const std::array<Index, 4>& in) {
    out.kind[at] = child.kind[in[0]] | child.kind[in[1]] | child.kind[in[2]] | child.kind[in[3]];
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
    averageLayers(*child, quadrantOf(parent.size, q), n, parent);
    if (!child->elevation.empty()) {
      parent.elevation.resize(n, kNan);
      averageElevation(*child, q, parent);
    }
  }
  if (parent.elevation.empty()) return parent;
  std::vector<float> bound = elevationMax(parent);
  for (int q = 0; q < 4; ++q) {
    const Tile* child = children[static_cast<Index>(q)];
    if (child == nullptr || child->elevation.empty()) continue;
    const std::vector<float> finer = elevationMax(*child);
    forCells(parent.size, quadrantOf(parent.size, q), [&](Index out, const std::array<Index, 4>& in) {
      for (const Index i : in) bound[out] = std::fmax(bound[out], finer[i]);
    });
  }
  parent.elevation_max = std::move(bound);
  return parent;
}

Tile halved(const Tile& child, Tile&& reuse) {
  Tile half = emptied(std::move(reuse));
  half.key = child.key;
  half.size = child.size / 2;
  averageLayers(child, {0, static_cast<Index>(half.size)}, half.texels(), half);
  return half;
}

Tile joinHalves(const geo::TileKey& key, const std::array<const Tile*, 4>& halves, Tile&& reuse) {
  Tile parent = emptied(std::move(reuse));
  parent.key = key;
  for (const Tile* half : halves)
    if (half != nullptr) parent.size = 2 * half->size;
  const Index n = parent.texels();
  for (int q = 0; q < 4; ++q) {
    const Tile* half = halves[static_cast<Index>(q)];
    if (half == nullptr) continue;
    const Target target = quadrantOf(parent.size, q);
    const auto side = static_cast<Index>(half->size);
    const auto put = [&](const std::vector<std::uint8_t>& from, std::vector<std::uint8_t>& to, Index bytes) {
      if (from.empty()) return;
      to.resize(bytes * n, 0);
      for (Index row = 0; row < side; ++row)
        std::memcpy(to.data() + bytes * (target.first + row * target.stride),
                    from.data() + bytes * row * side, bytes * side);
    };
    put(half->color, parent.color, 4);
    put(half->confidence, parent.confidence, 1);
    put(half->views, parent.views, 1);
    put(half->kind, parent.kind, 1);
    put(half->gsd, parent.gsd, 1);
    put(half->angle, parent.angle, 1);
  }
  return parent;
}

}  // namespace overfly::tiling
