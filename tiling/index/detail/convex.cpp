#include "tiling/index/detail/convex.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace overfly::tiling::detail {
namespace {

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

double signedArea(std::span<const Eigen::Vector2d> polygon) {
  double sum = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i)
    sum += cross(polygon[i], polygon[(i + 1) % polygon.size()]);
  return 0.5 * sum;
}

constexpr std::size_t kSquareCorners = 4;
const std::array<Eigen::Vector2d, kSquareCorners> kUnitSquare = {
    Eigen::Vector2d(0, 0), Eigen::Vector2d(1, 0), Eigen::Vector2d(1, 1), Eigen::Vector2d(0, 1)};

}  // namespace

double area(std::span<const Eigen::Vector2d> polygon) { return std::abs(signedArea(polygon)); }

Polygon intersection(std::span<const Eigen::Vector2d> subject, std::span<const Eigen::Vector2d> clip) {
  Polygon inside(subject.begin(), subject.end()), next;
  const double turn = signedArea(clip) < 0 ? -1 : 1;
  for (std::size_t e = 0; e < clip.size() && !inside.empty(); ++e) {
    const Eigen::Vector2d& from = clip[e];
    const Eigen::Vector2d along = clip[(e + 1) % clip.size()] - from;
    next.clear();
    for (std::size_t i = 0; i < inside.size(); ++i) {
      const Eigen::Vector2d &p = inside[i], &q = inside[(i + 1) % inside.size()];
      const double dp = turn * cross(along, p - from), dq = turn * cross(along, q - from);
      if (dp >= 0) next.push_back(p);
      if ((dp > 0 && dq < 0) || (dp < 0 && dq > 0)) next.push_back(p + (q - p) * (dp / (dp - dq)));
    }
    inside.swap(next);
  }
  return inside;
}

bool contains(std::span<const Eigen::Vector2d> polygon, const Eigen::Vector2d& point) {
  bool left = false, right = false;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const double side = cross(polygon[(i + 1) % polygon.size()] - polygon[i], point - polygon[i]);
    left |= side < 0;
    right |= side > 0;
  }
  return left != right;  // neither: a polygon without area
}

bool separated(std::span<const Eigen::Vector2d> a, std::span<const Eigen::Vector2d> b,
               std::span<const Eigen::Vector2d> axes) {
  const auto range = [](std::span<const Eigen::Vector2d> points, const Eigen::Vector2d& axis) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const Eigen::Vector2d& p : points) {
      low = std::min(low, p.dot(axis));
      high = std::max(high, p.dot(axis));
    }
    return std::pair{low, high};
  };
  return std::any_of(axes.begin(), axes.end(), [&](const Eigen::Vector2d& axis) {
    const auto [a_low, a_high] = range(a, axis);
    const auto [b_low, b_high] = range(b, axis);
    return a_high < b_low || b_high < a_low;
  });
}

std::array<Eigen::Vector2d, 4> footprintInTile(const IndexedFrame& record, double height_m,
                                               const geo::TileKey& key, double turns) {
  auto polygon = record.footprintAt(height_m);
  const Eigen::Vector2d corner = geo::TileLattice::planeOf(key);
  for (Eigen::Vector2d& p : polygon) {
    p.x() = std::ldexp(p.x() - turns - corner.x(), key.zoom);
    p.y() = std::ldexp(p.y() - corner.y(), key.zoom);
  }
  return polygon;
}

double turnsBetween(const IndexedFrame& record, const geo::TileKey& key, const geo::TileLattice& lattice) {
  if (lattice.kind() != geo::LatticeKind::WebMercator) return 0;
  return std::round(record.footprint[0].x() - geo::TileLattice::planeOf(key, 0.5, 0.5).x());
}

bool meetsTile(const IndexedFrame& record, const geo::TileKey& key, double turns, double min_height_m,
               double max_height_m) {
  // What the frame sees between the two heights is a truncated pyramid, whose outline in the plane is the
  // convex hull of the footprints at both. Its edges are edges of a footprint, or lie on lines from the nadir
  // point through a corner: their normals and the square's are all the axes that can separate.
  const auto low = footprintInTile(record, min_height_m, key, turns);
  const auto high = footprintInTile(record, max_height_m, key, turns);
  std::array<Eigen::Vector2d, 8> outline;
  std::copy(low.begin(), low.end(), outline.begin());
  std::copy(high.begin(), high.end(), outline.begin() + 4);
  std::array<Eigen::Vector2d, 10> axes = {Eigen::Vector2d::UnitX(), Eigen::Vector2d::UnitY()};
  const auto normal = [](const Eigen::Vector2d& along) { return Eigen::Vector2d(-along.y(), along.x()); };
  for (std::size_t i = 0; i < 4; ++i) {
    axes[2 + i] = normal(low[(i + 1) % 4] - low[i]);
    axes[6 + i] = normal(low[i] - high[i]);
  }
  return !separated(outline, kUnitSquare, axes);
}

}  // namespace overfly::tiling::detail
