#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "render/scene/description.h"

namespace overfly::scene {

// What lies on the ground: per texel the signed distances (positive inside, clamped to 4 m) to the nearest
// street, paving and planted bed, and the base class. Shaders and ray-tracer interpolate the distances, so
// that edges are sharp far below a texel. Row 0 in the south. Immutable once built; reentrant.
class CoverMap {
 public:
  CoverMap() = default;
  // Covers the rectangle, texels of `texel` metres.
  CoverMap(const Eigen::Vector2d& west_south, const Eigen::Vector2d& east_north, double texel, Base base);

  void paintArea(const std::vector<Eigen::Vector2d>& polygon, Base base);
  void paintStreet(const std::vector<Eigen::Vector2d>& points, double width);
  // A turned rectangle of slabs, or of planted soil.
  void paintPaving(const Eigen::Vector2d& centre, const Eigen::Vector2d& size, double turn);
  void paintBed(const Eigen::Vector2d& centre, const Eigen::Vector2d& size, double turn);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] const Eigen::Vector2d& origin() const { return origin_; }
  [[nodiscard]] double texel() const { return texel_; }
  // Street in the low byte, paving, bed, base in the high byte; distance = (byte - 128) / 32 metres.
  [[nodiscard]] const std::vector<std::uint32_t>& texels() const { return texels_; }
  // Clamped to the border.
  [[nodiscard]] std::uint32_t at(int x, int y) const;

  // Of the texel that holds the place.
  [[nodiscard]] double streetDistance(const Eigen::Vector2d& p) const { return distance(p, 0); }
  [[nodiscard]] double pavedDistance(const Eigen::Vector2d& p) const { return distance(p, 8); }
  [[nodiscard]] Base baseAt(const Eigen::Vector2d& p) const { return static_cast<Base>(texelAt(p) >> 24); }

 private:
  template <typename Distance>
  void paint(const Eigen::Vector2d& low, const Eigen::Vector2d& high, int shift, const Distance& distance);
  void paintRectangle(const Eigen::Vector2d& centre, const Eigen::Vector2d& size, double turn, int shift);
  [[nodiscard]] std::uint32_t texelAt(const Eigen::Vector2d& p) const;
  [[nodiscard]] double distance(const Eigen::Vector2d& p, int shift) const {
    return (static_cast<double>((texelAt(p) >> shift) & 255u) - 128) / 32;
  }

  Eigen::Vector2d origin_{0, 0};
  double texel_ = 1;
  int width_ = 0, height_ = 0;
  std::vector<std::uint32_t> texels_;
};

[[nodiscard]] bool insidePolygon(const Eigen::Vector2d& p, const std::vector<Eigen::Vector2d>& polygon);
// Distance from p to the polyline, metres.
[[nodiscard]] double distanceToLine(const Eigen::Vector2d& p, const std::vector<Eigen::Vector2d>& points);

}  // namespace overfly::scene
