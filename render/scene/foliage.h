#pragma once
#include <Eigen/Core>
#include <vector>

#include "render/amplify/plant.h"

namespace overfly::scene {

// One polygon of a plant: a square of leaves, in units of the crown's radius (horizontally) and the plant's
// height (vertically) from the plant's foot.
struct FoliagePolygon {
  Eigen::Vector3f centre{0, 0, 0};
  Eigen::Vector3f u_axis{1, 0, 0};  // half side
  Eigen::Vector3f v_axis{0, 1, 0};
  Eigen::Vector3f normal{0, 0, 1};  // for the light: out of the crown, unit
};

inline constexpr int kFoliageLods = 3;
inline constexpr int kFoliagePolygons[kFoliageLods] = {17, 8, 2};  // Amara et al., section 5

// The polygons of a species at a level of detail; 0 is the one that the truth holds.
[[nodiscard]] std::vector<FoliagePolygon> foliageOf(amplify::Species species, int lod);

}  // namespace overfly::scene
