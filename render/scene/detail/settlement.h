#pragma once
#include <vector>

#include "render/scene/cover.h"
#include "render/scene/mesh.h"
#include "render/scene/terrain.h"

namespace overfly::scene {

// A turned rectangle on the ground.
struct Footprint2 {
  Eigen::Vector2d centre{0, 0};
  Eigen::Vector2d half{0, 0};
  double turn = 0;

  [[nodiscard]] Eigen::Vector2d at(double along, double across) const;  // from the centre, metres
  [[nodiscard]] bool touches(const Footprint2& other) const;            // separating axes
  [[nodiscard]] double distance(const Eigen::Vector2d& p) const;        // 0 inside
};

// What the generators share: where to build, what is taken.
struct Site {
  const SceneDescription& scene;
  const Terrain& terrain;
  SolidBuilder& solids;
  CoverMap& cover;
  std::vector<Footprint2> taken;  // ground that buildings, sheds and cars stand on

  // Least and greatest height of the ground under a footprint.
  [[nodiscard]] std::pair<double, double> groundUnder(const Footprint2& footprint) const;
};

// Houses, gardens, hedges and parked cars along the streets that ask for them.
void buildSettlement(Site& site);
void buildCity(Site& site, const CityDescription& city);
void buildCanyon(Site& site, const CanyonDescription& canyon);
void buildBuildings(Site& site);

// A car of two boxes: body with painted sides and cabin with glass.
void buildCar(SolidBuilder& solids, const Eigen::Vector2d& centre, double turn, double ground,
              std::uint32_t number);

}  // namespace overfly::scene
