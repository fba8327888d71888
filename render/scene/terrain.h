#pragma once
#include <Eigen/Core>
#include <vector>

#include "config/error.h"
#include "render/amplify/selector.h"
#include "render/scene/mesh.h"

namespace overfly::scene {

// The bare ground: heights on a square grid, two triangles a cell. The triangles are the truth; between the
// grid's corners the height is that of the triangle. Immutable after make(); reentrant.
class Terrain {
 public:
  // BadSettings: the height map cannot be read.
  [[nodiscard]] static Result<Terrain> make(const TerrainDescription& description, std::uint32_t seed);

  // Height of the ground, metres in scene ENU; clamped to the border outside.
  [[nodiscard]] double heightAt(double east, double north) const;
  // Rise per metre there.
  [[nodiscard]] double steepnessAt(double east, double north) const;
  [[nodiscard]] Eigen::Vector2d west_south() const { return origin_; }
  [[nodiscard]] Eigen::Vector2d east_north() const;

  // Borrows the heights.
  [[nodiscard]] amplify::HeightGrid grid() const { return {origin_, spacing_, columns_, rows_, heights_}; }

  [[nodiscard]] Mesh mesh(double chunk_cell) const;

 private:
  [[nodiscard]] double corner(int x, int y) const {
    return heights_[static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_) +
                    static_cast<std::size_t>(x)];
  }
  Eigen::Vector2d origin_{0, 0};
  double spacing_ = 1;
  int columns_ = 0, rows_ = 0;  // of corners
  std::vector<float> heights_;
};

}  // namespace overfly::scene
