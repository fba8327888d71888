#include "render/preview/reference_caster.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace overfly::preview {
namespace {
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kChord = 10;
}  // namespace

ReferenceCaster::ReferenceCaster(const HeightGrid& grid, Surface surface) : grid_(grid), surface_(surface) {
  lowest_ = kInfinity;
  highest_ = -kInfinity;
  for (int y = 0; y < grid.height(); ++y) {
    for (int x = 0; x < grid.width(); ++x) {
      if (!grid.valid(x, y)) continue;
      lowest_ = std::min(lowest_, static_cast<double>(grid.at(x, y)));
      highest_ = std::max(highest_, static_cast<double>(grid.at(x, y)));
    }
  }
  lowest_ -= kWallFoot;
}

// Share of the way from `in` to `out`, both over the texel (its coordinates, absolute heights), where the ray
// is on or below the surface for the first time.
std::optional<double> ReferenceCaster::meet(int x, int y, const Eigen::Vector3d& in,
                                            const Eigen::Vector3d& out) const {
  const Neighbourhood h = grid_.around(x, y);
  // No surface rises above the nine (test: PreviewSurface).
  if (std::min(in.z(), out.z()) > *std::max_element(h.begin(), h.end())) return std::nullopt;
  const auto above = [&](double s) {
    const Eigen::Vector3d p = in + s * (out - in);
    return p.z() -
           surfaceHeight(surface_, h, std::clamp(p.x() - x, 0.0, 1.0), std::clamp(p.y() - y, 0.0, 1.0));
  };
  if (above(0) <= 0) return 0;
  constexpr int kSamples = 64;
  for (int i = 1; i <= kSamples; ++i) {
    double b = static_cast<double>(i) / kSamples;
    if (above(b) > 0) continue;
    double a = static_cast<double>(i - 1) / kSamples;
    for (int k = 0; k < 50; ++k) {
      const double m = (a + b) / 2;
      (above(m) > 0 ? a : b) = m;
    }
    return b;
  }
  return std::nullopt;
}

std::optional<ReferenceHit> ReferenceCaster::cast(const RayFrame& frame, const Eigen::Vector3d& direction,
                                                  double length_m, const Eigen::Vector3d& offset) const {
  if (!(highest_ >= lowest_)) return std::nullopt;
  // The start first: one that is meant to be on a cell's border stays there.
  const Eigen::Vector3d start =
      (frame.start + offset) + Eigen::Vector3d(frame.cell.x(), frame.cell.y(), frame.base_height_m);
  const auto at = [&](double t) -> Eigen::Vector3d {
    return start + (frame.at(direction, t) - frame.at(direction, 0));
  };
  double begin = kInfinity;  // where the ray enters the grid
  for (double ta = 0; ta < length_m; ta += kChord) {
    const double tb = std::min(ta + kChord, length_m);
    const Eigen::Vector3d a = at(ta), d = at(tb) - a;
    if (std::min(a.z(), a.z() + d.z()) > highest_) {
      if (d.z() >= 0) return std::nullopt;  // the Earth only falls away: it never comes down again
      continue;
    }
    // The part of the chord that lies over the grid.
    double s0 = 0, s1 = 1;
    for (int k = 0; k < 2; ++k) {
      const double size = k == 0 ? grid_.width() : grid_.height();
      if (d[k] == 0) {
        if (a[k] < 0 || a[k] >= size) s1 = -1;
        continue;
      }
      const double u = -a[k] / d[k], v = (size - a[k]) / d[k];
      s0 = std::max(s0, std::min(u, v));
      s1 = std::min(s1, std::max(u, v));
    }
    if (s0 > s1) continue;
    const Eigen::Vector3d first = a + s0 * d;
    int x = std::clamp(static_cast<int>(std::floor(first.x())), 0, grid_.width() - 1);
    int y = std::clamp(static_cast<int>(std::floor(first.y())), 0, grid_.height() - 1);
    double s = s0;
    while (s <= s1 && grid_.inside(x, y)) {
      const double sx = d.x() == 0 ? kInfinity : (x + (d.x() > 0 ? 1 : 0) - a.x()) / d.x();
      const double sy = d.y() == 0 ? kInfinity : (y + (d.y() > 0 ? 1 : 0) - a.y()) / d.y();
      const double end = std::max(s, std::min({sx, sy, s1}));
      const double t = ta + s * (tb - ta);
      if (a.z() + s * d.z() < lowest_ && d.z() < 0 && t > begin) return std::nullopt;
      begin = std::min(begin, t);
      if (grid_.valid(x, y)) {
        const Eigen::Vector3d in = a + s * d, out = a + end * d;
        if (const auto share = meet(x, y, in, out)) {
          const Eigen::Vector3d p = in + *share * (out - in);
          return ReferenceHit{ta + (s + *share * (end - s)) * (tb - ta), {p.x(), p.y()}, p.z()};
        }
      }
      if (std::min(sx, sy) > s1) break;
      (sx <= sy ? x : y) += (sx <= sy ? d.x() : d.y()) > 0 ? 1 : -1;
      s = end;
    }
  }
  return std::nullopt;
}

}  // namespace overfly::preview
