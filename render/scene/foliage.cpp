#include "render/scene/foliage.h"

#include <cmath>
#include <numbers>

namespace overfly::scene {
namespace {

using Eigen::Vector3f;

// A square of half side `size` (radii) whose upward normal leans out of the crown by `lean` radians.
FoliagePolygon leaning(float angle, float from_axis, float height, float size, float lean, float size_up) {
  const Vector3f outward(std::cos(angle), std::sin(angle), 0), around(-std::sin(angle), std::cos(angle), 0);
  FoliagePolygon polygon;
  polygon.centre = from_axis * outward + Vector3f(0, 0, height);
  polygon.u_axis = size * around;
  polygon.v_axis = -size * std::cos(lean) * outward + Vector3f(0, 0, size_up * std::sin(lean));
  polygon.normal = (std::sin(0.8f * lean) * outward + Vector3f(0, 0, std::cos(0.8f * lean))).normalized();
  return polygon;
}

constexpr float kGolden = 2.39996323f;

std::vector<FoliagePolygon> broadleaf(int count) {
  std::vector<FoliagePolygon> polygons;
  // A wide layer closes the crown from above; clumps lean out of its upper half on a golden-angle spiral.
  polygons.push_back(leaning(0.3f, 0, 0.52f, count > 2 ? 0.92f : 1.05f, 0.0f, 0.3f));
  for (int i = 1; i < count; ++i) {
    const float t = static_cast<float>(i - 1) / static_cast<float>(std::max(1, count - 2));  // 0 top .. 1 rim
    const float from_axis = count > 2 ? 0.72f * std::sqrt(t) : 0.0f;
    const float height = 0.93f - 0.38f * from_axis * from_axis / 0.5f;
    const float size = (count > 8 ? 0.40f : 0.55f) * (count > 2 ? 1.0f : 1.6f);
    polygons.push_back(
        leaning(kGolden * static_cast<float>(i), from_axis, height, size, 0.15f + 0.75f * t, 0.16f));
  }
  return polygons;
}

std::vector<FoliagePolygon> conifer(int count) {
  std::vector<FoliagePolygon> polygons;
  // Whorls: narrower towards the top.
  for (int i = 0; i < count; ++i) {
    const float t = static_cast<float>(i) / static_cast<float>(count - 1);  // 0 lowest
    const float size = (count > 2 ? 0.62f : 0.95f) * (1.0f - 0.72f * t);
    const float from_axis = count > 2 ? 0.42f * (1.0f - t) : 0.0f;
    polygons.push_back(leaning(kGolden * static_cast<float>(i), from_axis, 0.18f + 0.78f * t, size,
                               count > 2 ? 0.75f : 0.2f, 0.12f));
  }
  return polygons;
}

std::vector<FoliagePolygon> shrub(int count) {
  std::vector<FoliagePolygon> polygons = broadleaf(count);
  for (FoliagePolygon& polygon : polygons) polygon.centre.z() = 1.15f * polygon.centre.z() - 0.22f;
  return polygons;
}

}  // namespace

std::vector<FoliagePolygon> foliageOf(amplify::Species species, int lod) {
  const int count = kFoliagePolygons[lod];
  switch (species) {
    case amplify::Species::Conifer:
      return conifer(count);
    case amplify::Species::Shrub:
      return shrub(count);
    case amplify::Species::Broadleaf:
      return broadleaf(count);
    case amplify::Species::None:
      break;
  }
  return {};
}

}  // namespace overfly::scene
