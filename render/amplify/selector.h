#pragma once
#include <Eigen/Core>
#include <array>
#include <chrono>
#include <memory>
#include <span>

#include "render/amplify/population.h"
#include "render/gl/buffer.h"
#include "render/gl/context.h"
#include "render/gl/program.h"
#include "render/gl/texture.h"

namespace overfly::amplify {

// The ground as the selection reads it: heights of a square grid's corners, rows from the south.
struct HeightGrid {
  Eigen::Vector2d corner{0, 0};  // south-west, metres
  double spacing = 1;            // metres
  int columns = 0, rows = 0;     // of corners
  std::span<const float> heights;
};

// What plants are selected for. Planes have inward unit normals, scene ENU.
struct PlantView {
  std::array<Eigen::Vector4d, 6> planes;
  Eigen::Vector3d eye{0, 0, 0};
  Eigen::Vector3d rings{700, 1400, 3000};  // LOD 0, 1, 2 up to these distances, metres (Amara et al., 4.2)
};

// What a selection cost, as the paper's table 1 has it: its pass 1 (tile load map) and pass 3 (seeds: chosen,
// compacted, packed).
struct SelectionCost {
  double load_map_ms = 0, select_ms = 0, compact_ms = 0;
  std::size_t checked_seeds = 0;  // of the tiles that the load map left in
};

inline constexpr int kPlantBins = 9;  // (species - 1) * 3 + LOD

// Selects a view's plants on the GPU, from nothing but patterns, land cover, ground and rules (Amara et al.,
// 4.2 to 4.5): tile load map, seed selection with culling, stream compaction, packed instances. The same
// plants stand at the same place in every view, those of allPlants(). The order of instances does not depend
// on the GPU's scheduling. Thread-bound to its context.
//
// Deviations: the three tile maps are one compute pass each instead of render-to-texture; only the counts are
// read back; seeds hidden by the ground are not culled, since from above there are hardly any.
class PlantSelector {
 public:
  // `capacity`: the most plants of one bin; what goes beyond is not drawn.
  [[nodiscard]] static Result<PlantSelector> create(gl::Context& context, const Population& population,
                                                    const HeightGrid& ground, int capacity);

  // Fills instances(); the counts are those of each bin.
  [[nodiscard]] Result<std::array<int, kPlantBins>> select(const PlantView& view);

  // Waits after every pass, so that lastCost() can be read; costs a little.
  void measure(bool on) { measure_ = on; }
  [[nodiscard]] const SelectionCost& lastCost() const { return cost_; }

  // Plants of bin b begin at b * capacity() * sizeof(Plant).
  [[nodiscard]] const gl::Buffer& instances() const { return instances_; }
  [[nodiscard]] int capacity() const { return capacity_; }
  // Of the whole population, visible or not.
  [[nodiscard]] std::size_t tiles() const {
    return static_cast<std::size_t>(range_.x1 - range_.x0) * static_cast<std::size_t>(range_.y1 - range_.y0);
  }

 private:
  PlantSelector() = default;
  void finishPass(double& milliseconds);
  void setInputs(gl::Program& program, const PlantView& view);

  gl::Context* context_ = nullptr;
  bool measure_ = false;
  std::chrono::steady_clock::time_point pass_start_;
  SelectionCost cost_;
  Population::TileRange range_;
  int capacity_ = 0;
  std::uint32_t seed_ = 0;
  std::array<SpeciesRule, 4> rules_;
  Eigen::Vector2f cover_corner_{0, 0}, grid_corner_{0, 0}, ground_range_{0, 0};
  float spacing_ = 1;
  gl::Program load_map_, select_, scan_, scatter_;
  gl::Buffer patterns_, tile_map_, slots_, counts_, totals_, instances_;
  gl::Texture cover_, heights_;
};

}  // namespace overfly::amplify
