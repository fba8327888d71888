#include "render/scene/cover.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace overfly::scene {
namespace {
constexpr double kReach = 4;  // metres: distances are clamped to it
}

bool insidePolygon(const Eigen::Vector2d& p, const std::vector<Eigen::Vector2d>& polygon) {
  bool inside = false;
  for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++) {
    const Eigen::Vector2d &a = polygon[i], &b = polygon[j];
    if ((a.y() > p.y()) != (b.y() > p.y()) &&
        p.x() < (b.x() - a.x()) * (p.y() - a.y()) / (b.y() - a.y()) + a.x()) {
      inside = !inside;
    }
  }
  return inside;
}

double distanceToLine(const Eigen::Vector2d& p, const std::vector<Eigen::Vector2d>& points) {
  double best = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const Eigen::Vector2d along = points[i + 1] - points[i];
    const double t = std::clamp((p - points[i]).dot(along) / along.squaredNorm(), 0.0, 1.0);
    best = std::min(best, (p - points[i] - t * along).norm());
  }
  return best;
}

CoverMap::CoverMap(const Eigen::Vector2d& west_south, const Eigen::Vector2d& east_north, double texel,
                   Base base)
    : origin_(west_south), texel_(texel) {
  const Eigen::Vector2d size = (east_north - west_south) / texel;
  width_ = std::max(1, static_cast<int>(std::ceil(size.x())));
  height_ = std::max(1, static_cast<int>(std::ceil(size.y())));
  texels_.assign(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_),
                 static_cast<std::uint32_t>(base) << 24);
}

std::uint32_t CoverMap::at(int x, int y) const {
  x = std::clamp(x, 0, width_ - 1);
  y = std::clamp(y, 0, height_ - 1);
  return texels_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                 static_cast<std::size_t>(x)];
}

std::uint32_t CoverMap::texelAt(const Eigen::Vector2d& p) const {
  const Eigen::Vector2d q = (p - origin_) / texel_;
  return at(static_cast<int>(std::floor(q.x())), static_cast<int>(std::floor(q.y())));
}

template <typename Distance>
void CoverMap::paint(const Eigen::Vector2d& low, const Eigen::Vector2d& high, int shift,
                     const Distance& inside) {
  const Eigen::Vector2d a = (low - origin_).array() / texel_, b = (high - origin_).array() / texel_;
  const int x0 = std::clamp(static_cast<int>(std::floor(a.x())), 0, width_),
            x1 = std::clamp(static_cast<int>(std::ceil(b.x())), 0, width_);
  const int y0 = std::clamp(static_cast<int>(std::floor(a.y())), 0, height_),
            y1 = std::clamp(static_cast<int>(std::ceil(b.y())), 0, height_);
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x) {
      std::uint32_t& texel = texels_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                                     static_cast<std::size_t>(x)];
      const double metres = inside(Eigen::Vector2d(origin_ + texel_ * Eigen::Vector2d(x + 0.5, y + 0.5)));
      const auto code = static_cast<std::uint32_t>(std::clamp(128 + std::lround(32 * metres), 0L, 255L));
      texel = (texel & ~(255u << shift)) | std::max(code, (texel >> shift) & 255u) << shift;
    }
  }
}

void CoverMap::paintArea(const std::vector<Eigen::Vector2d>& polygon, Base base) {
  Eigen::Vector2d low = polygon.front(), high = polygon.front();
  for (const Eigen::Vector2d& p : polygon) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Eigen::Vector2d a = (low - origin_) / texel_, b = (high - origin_) / texel_;
  const int x0 = std::clamp(static_cast<int>(a.x()), 0, width_),
            x1 = std::clamp(static_cast<int>(b.x()) + 1, 0, width_);
  const int y0 = std::clamp(static_cast<int>(a.y()), 0, height_),
            y1 = std::clamp(static_cast<int>(b.y()) + 1, 0, height_);
  for (int y = y0; y < y1; ++y) {
    for (int x = x0; x < x1; ++x) {
      if (!insidePolygon(origin_ + texel_ * Eigen::Vector2d(x + 0.5, y + 0.5), polygon)) continue;
      std::uint32_t& texel = texels_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                                     static_cast<std::size_t>(x)];
      texel = (texel & 0xffffffu) | static_cast<std::uint32_t>(base) << 24;
    }
  }
}

void CoverMap::paintStreet(const std::vector<Eigen::Vector2d>& points, double width) {
  Eigen::Vector2d low = points.front(), high = points.front();
  for (const Eigen::Vector2d& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Eigen::Vector2d border = Eigen::Vector2d::Constant(0.5 * width + kReach + texel_);
  paint(low - border, high + border, 0,
        [&](const Eigen::Vector2d& p) { return 0.5 * width - distanceToLine(p, points); });
}

void CoverMap::paintRectangle(const Eigen::Vector2d& centre, const Eigen::Vector2d& size, double turn,
                              int shift) {
  const Eigen::Vector2d border = Eigen::Vector2d::Constant(0.5 * size.norm() + kReach + texel_);
  const Eigen::Rotation2Dd back(-turn);
  paint(centre - border, centre + border, shift, [&](const Eigen::Vector2d& p) {
    const Eigen::Vector2d d = (back * (p - centre)).cwiseAbs() - 0.5 * size;
    return -(d.cwiseMax(0).norm() + std::min(d.maxCoeff(), 0.0));
  });
}

void CoverMap::paintPaving(const Eigen::Vector2d& centre, const Eigen::Vector2d& size, double turn) {
  paintRectangle(centre, size, turn, 8);
}

void CoverMap::paintBed(const Eigen::Vector2d& centre, const Eigen::Vector2d& size, double turn) {
  paintRectangle(centre, size, turn, 16);
}

}  // namespace overfly::scene
