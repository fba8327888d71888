#include "render/scene/geometry.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "render/scene/appearance.h"

namespace overfly::scene {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

struct Bounds {
  Vector3f low = Vector3f::Constant(std::numeric_limits<float>::infinity());
  Vector3f high = Vector3f::Constant(-std::numeric_limits<float>::infinity());
  void add(const Vector3f& p) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  void add(const Bounds& b) {
    low = low.cwiseMin(b.low);
    high = high.cwiseMax(b.high);
  }
  [[nodiscard]] float area() const {
    const Vector3f d = (high - low).cwiseMax(0);
    return d.x() * d.y() + d.y() * d.z() + d.z() * d.x();
  }
};

Bounds boundsOf(const amplify::Plant& plant) {
  // No polygon reaches beyond 1.4 radii (with ragged edges 1.5) or above the top by a tenth.
  const float reach = 1.6f * plant.radius;
  Bounds bounds;
  bounds.add({plant.east - reach, plant.north - reach, plant.up - 0.2f * plant.height});
  bounds.add({plant.east + reach, plant.north + reach, plant.up + 1.25f * plant.height});
  return bounds;
}

// Slab test; near distance or infinity.
double enters(const Vector3f& low, const Vector3f& high, const Vector3d& origin, const Vector3d& inverse,
              double least, double most) {
  const Vector3d a = (low.cast<double>() - origin).cwiseProduct(inverse),
                 b = (high.cast<double>() - origin).cwiseProduct(inverse);
  double near = least, far = most;
  for (int i = 0; i < 3; ++i) {
    const double from = std::min(a[i], b[i]), to = std::max(a[i], b[i]);
    // A ray in the slab's plane gives NaN: comparisons then leave the interval as it is.
    if (from > near) near = from;
    if (to < far) far = to;
  }
  return near <= far * (1 + 1e-12) ? near : std::numeric_limits<double>::infinity();
}

}  // namespace

Geometry::Geometry(const World& world) : world_(world) {
  for (std::uint32_t species = 1; species < 4; ++species)
    foliage_[species] = foliageOf(static_cast<amplify::Species>(species), 0);
  build();
}

void Geometry::build() {
  std::vector<Bounds> bounds;
  const auto addMesh = [&](const Mesh& mesh, Hit::Kind kind) {
    for (std::uint32_t t = 0; t < mesh.triangles(); ++t) {
      Bounds b;
      for (std::size_t k = 0; k < 3; ++k) b.add(mesh.corner(3 * t + k));
      primitives_.push_back({kind, t});
      bounds.push_back(b);
    }
  };
  addMesh(world_.ground, Hit::Kind::Ground);
  addMesh(world_.solids, Hit::Kind::Solid);
  for (std::uint32_t p = 0; p < world_.plants.size(); ++p) {
    primitives_.push_back({Hit::Kind::Leaf, p});
    bounds.push_back(boundsOf(world_.plants[p]));
  }
  std::vector<std::uint32_t> order(primitives_.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;

  // Binned surface-area heuristic, depth first over an explicit stack.
  constexpr int kBins = 12;
  constexpr std::uint32_t kLeaf = 3;
  nodes_.reserve(primitives_.size());
  nodes_.push_back({Vector3f::Zero(), Vector3f::Zero(), 0, static_cast<std::uint32_t>(primitives_.size())});
  std::vector<std::uint32_t> open = {0};
  while (!open.empty()) {
    const std::uint32_t at = open.back();
    open.pop_back();
    const std::uint32_t first = nodes_[at].first, count = nodes_[at].count;
    Bounds whole, middles;
    for (std::uint32_t i = first; i < first + count; ++i) {
      whole.add(bounds[order[i]]);
      middles.add(Vector3f(0.5f * (bounds[order[i]].low + bounds[order[i]].high)));
    }
    nodes_[at].low = whole.low;
    nodes_[at].high = whole.high;
    if (count <= kLeaf) continue;
    int axis = 0;
    const Vector3f spread = middles.high - middles.low;
    spread.maxCoeff(&axis);
    if (!(spread[axis] > 0)) continue;
    const auto binOf = [&](std::uint32_t primitive) {
      const float middle = 0.5f * (bounds[primitive].low[axis] + bounds[primitive].high[axis]);
      return std::min(kBins - 1, static_cast<int>((middle - middles.low[axis]) / spread[axis] * kBins));
    };
    std::array<Bounds, kBins> bin_bounds;
    std::array<std::uint32_t, kBins> bin_count{};
    for (std::uint32_t i = first; i < first + count; ++i) {
      const auto bin = static_cast<std::size_t>(binOf(order[i]));
      bin_bounds[bin].add(bounds[order[i]]);
      ++bin_count[bin];
    }
    std::array<float, kBins> right_cost{};
    Bounds right;
    std::uint32_t right_count = 0;
    for (std::size_t i = kBins - 1; i > 0; --i) {
      right.add(bin_bounds[i]);
      right_count += bin_count[i];
      right_cost[i] = right_count ? right.area() * static_cast<float>(right_count) : 0;
    }
    float best = std::numeric_limits<float>::infinity();
    std::size_t split = 1;
    Bounds left;
    std::uint32_t left_count = 0;
    for (std::size_t i = 1; i < kBins; ++i) {
      left.add(bin_bounds[i - 1]);
      left_count += bin_count[i - 1];
      const float cost = (left_count ? left.area() * static_cast<float>(left_count) : 0) + right_cost[i];
      if (left_count > 0 && left_count < count && cost < best) {
        best = cost;
        split = i;
      }
    }
    const auto begin = order.begin() + first;
    const auto middle = std::stable_partition(
        begin, begin + count, [&](std::uint32_t p) { return static_cast<std::size_t>(binOf(p)) < split; });
    const auto left_size = static_cast<std::uint32_t>(middle - begin);
    if (left_size == 0 || left_size == count) continue;
    const auto child = static_cast<std::uint32_t>(nodes_.size());
    nodes_[at].first = child;
    nodes_[at].count = 0;
    nodes_.push_back({Vector3f::Zero(), Vector3f::Zero(), first, left_size});
    nodes_.push_back({Vector3f::Zero(), Vector3f::Zero(), first + left_size, count - left_size});
    open.push_back(child);
    open.push_back(child + 1);
  }
  std::vector<Primitive> sorted;
  sorted.reserve(primitives_.size());
  for (const std::uint32_t i : order) sorted.push_back(primitives_[i]);
  primitives_ = std::move(sorted);
}

Geometry::Leaf Geometry::leafOf(std::uint32_t plant_index, std::uint32_t polygon_index) const {
  const amplify::Plant& plant = world_.plants[plant_index];
  const FoliagePolygon& polygon = foliage_[plant.species][polygon_index];
  const float cosine = std::cos(plant.turn), sine = std::sin(plant.turn);
  const auto turned = [&](const Vector3f& p) {
    return Vector3f(cosine * p.x() - sine * p.y(), sine * p.x() + cosine * p.y(), p.z());
  };
  const auto sized = [&](const Vector3f& p) {
    return Vector3f(p.x() * plant.radius, p.y() * plant.radius, p.z() * plant.height);
  };
  Leaf leaf;
  leaf.centre = (turned(sized(polygon.centre)) + Vector3f(plant.east, plant.north, plant.up)).cast<double>();
  leaf.u_axis = turned(sized(polygon.u_axis)).cast<double>();
  leaf.v_axis = turned(sized(polygon.v_axis)).cast<double>();
  leaf.normal = turned(polygon.normal);
  leaf.metres = plant.radius * polygon.u_axis.norm();
  leaf.depth = polygon.centre.z();
  leaf.clump = plant.seed + polygon_index * 0x9e3779b1u;
  return leaf;
}

void Geometry::intersect(const Primitive& primitive, const Ray& ray, double least, Hit& best,
                         bool& found) const {
  if (primitive.kind != Hit::Kind::Leaf) {
    const Mesh& mesh = primitive.kind == Hit::Kind::Ground ? world_.ground : world_.solids;
    const Vector3d a = mesh.corner(3 * primitive.index).cast<double>();
    const Vector3d e1 = mesh.corner(3 * primitive.index + 1).cast<double>() - a;
    const Vector3d e2 = mesh.corner(3 * primitive.index + 2).cast<double>() - a;
    const Vector3d p = ray.direction.cross(e2);  // Moeller and Trumbore 1997, both sides
    const double determinant = e1.dot(p);
    if (determinant == 0) return;
    const Vector3d s = ray.origin - a;
    const double u = s.dot(p) / determinant;
    // A hair of overlap: a ray through a shared edge must not slip through.
    constexpr double kHair = 1e-9;
    if (u < -kHair || u > 1 + kHair) return;
    const Vector3d q = s.cross(e1);
    const double v = ray.direction.dot(q) / determinant;
    if (v < -kHair || u + v > 1 + kHair) return;
    const double distance = e2.dot(q) / determinant;
    if (distance > least && distance < best.distance) {
      best = {distance, primitive.kind, primitive.index};
      found = true;
    }
    return;
  }
  const auto polygons = static_cast<std::uint32_t>(foliage_[world_.plants[primitive.index].species].size());
  for (std::uint32_t i = 0; i < polygons; ++i) {
    const Leaf leaf = leafOf(primitive.index, i);
    const Vector3d normal = leaf.u_axis.cross(leaf.v_axis);
    const double along = ray.direction.dot(normal);
    if (along == 0) continue;
    const double distance = (leaf.centre - ray.origin).dot(normal) / along;
    if (!(distance > least && distance < best.distance)) continue;
    const Vector3d local = ray.origin + distance * ray.direction - leaf.centre;
    const glsl::vec2 uv(static_cast<float>(local.dot(leaf.u_axis) / leaf.u_axis.squaredNorm()),
                        static_cast<float>(local.dot(leaf.v_axis) / leaf.v_axis.squaredNorm()));
    if (std::abs(uv.x) > 1 || std::abs(uv.y) > 1 || Appearance::leafCover(uv, leaf.metres, leaf.clump) <= 0)
      continue;
    best = {distance, Hit::Kind::Leaf, primitive.index * 32 + i};
    found = true;
  }
}

std::optional<Hit> Geometry::firstHit(const Ray& ray, double least, double most) const {
  if (primitives_.empty()) return std::nullopt;
  const Vector3d inverse = ray.direction.cwiseInverse();
  Hit best;
  best.distance = most;
  bool found = false;
  std::array<std::uint32_t, 128> stack;
  std::size_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const Node& node = nodes_[stack[--depth]];
    if (enters(node.low, node.high, ray.origin, inverse, least, best.distance) ==
        std::numeric_limits<double>::infinity())
      continue;
    if (node.count > 0) {
      for (std::uint32_t i = node.first; i < node.first + node.count; ++i)
        intersect(primitives_[i], ray, least, best, found);
      continue;
    }
    const double left =
        enters(nodes_[node.first].low, nodes_[node.first].high, ray.origin, inverse, least, best.distance);
    const double right = enters(nodes_[node.first + 1].low, nodes_[node.first + 1].high, ray.origin, inverse,
                                least, best.distance);
    if (depth + 2 > stack.size()) break;
    stack[depth++] = left <= right ? node.first + 1 : node.first;  // the nearer one is looked at first
    stack[depth++] = left <= right ? node.first : node.first + 1;
  }
  return found ? std::optional<Hit>(best) : std::nullopt;
}

bool Geometry::blocked(const Ray& ray, double least, double most) const {
  return firstHit(ray, least, most).has_value();
}

Facet Geometry::facetOf(const Hit& hit) const {
  if (hit.kind == Hit::Kind::Leaf) {
    const Leaf leaf = leafOf(hit.primitive / 32, hit.primitive % 32);
    return {leaf.centre, leaf.u_axis.cross(leaf.v_axis).normalized()};
  }
  const Mesh& mesh = hit.kind == Hit::Kind::Ground ? world_.ground : world_.solids;
  const Vector3d a = mesh.corner(3 * hit.primitive).cast<double>();
  return {a, (mesh.corner(3 * hit.primitive + 1).cast<double>() - a)
                 .cross(mesh.corner(3 * hit.primitive + 2).cast<double>() - a)
                 .normalized()};
}

}  // namespace overfly::scene
