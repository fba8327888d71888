#pragma once
#include <Eigen/Core>
#include <memory>
#include <vector>

#include "capture/geo/geodetic.h"
#include "render/amplify/population.h"
#include "render/scene/cover.h"
#include "render/scene/description.h"
#include "render/scene/mesh.h"
#include "render/scene/terrain.h"

namespace overfly::scene {

// A scene made solid: triangles, ground cover and plants in the East-North-Up frame of its place. What the
// rasteriser, the ray-tracer and the truth all read. Immutable after buildWorld(); reentrant.
struct World {
  SceneDescription description;
  geo::LocalFrame local;  // scene ENU
  Terrain terrain;
  Mesh ground;  // the terrain's triangles
  Mesh solids;  // buildings, hedges, cars, rock
  CoverMap cover;
  amplify::Population population;
  std::vector<amplify::Plant> plants;    // all of them: population's plants, for the ray-tracer and the truth
  Eigen::Vector3d towards_sun{0, 0, 1};  // unit

  [[nodiscard]] amplify::GroundPoint groundAt(float east, float north) const;
};

// BadSettings: the description names a file that cannot be read.
[[nodiscard]] Result<std::shared_ptr<const World>> buildWorld(const SceneDescription& description);

}  // namespace overfly::scene
