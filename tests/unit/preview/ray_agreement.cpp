#include "tests/unit/preview/ray_agreement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>

#include "render/preview/reference_caster.h"

namespace overfly::preview {

std::vector<SingleRay> randomRays(std::uint64_t seed, int kind, std::size_t count, const Scene& scene,
                                  const RayFrame& frame) {
  std::mt19937_64 random(seed);
  const auto uniform = [&](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  std::vector<SingleRay> rays;
  const double size = scene.map.texels(), texel = scene.domain.texelSize();
  const Eigen::Vector2d corner = scene.domain.minTexel();
  while (rays.size() < count) {
    Eigen::Vector3d at(corner.x() + uniform(-0.2, 1.2) * size, corner.y() + uniform(-0.2, 1.2) * size,
                       uniform(448, 490));
    double heading = uniform(0, 6.2831853), pitch = uniform(-1.5, 0.2);
    switch (kind) {
      case 0:
        break;  // anything
      case 1:
        heading = 1.5707963267948966 * std::floor(uniform(0, 4));
        break;  // along an axis
      case 2:   // along cell borders
        heading = 1.5707963267948966 * std::floor(uniform(0, 4));
        at = {std::floor(at.x()), std::floor(at.y()), at.z()};
        break;
      case 3:
        pitch = -1.7453e-4;
        at.z() = uniform(447, 462);
        break;  // grazing at 0.01 degrees
      case 4:
        pitch = uniform(0, 1.57);
        at.z() = uniform(440, 460);
        break;  // upwards
      case 5:
        at.z() = uniform(430, 449);
        break;  // from inside and below the terrain
      case 6:   // from 10 km
        pitch = uniform(-1.5707963, -0.9);
        at.z() = 10000;
        at.head<2>() =
            corner + Eigen::Vector2d(uniform(0.1, 0.9), uniform(0.1, 0.9)) * size -
            Eigen::Vector2d(std::sin(heading), -std::cos(heading)) * (9553 / std::tan(-pitch) / texel);
        break;
      case 7:
        pitch = uniform(-0.02, 0.005);
        break;   // towards the horizon
      case 8: {  // components that are zero
        const int zero = static_cast<int>(uniform(0, 3));
        if (zero == 0) pitch = 0;
        if (zero == 1) pitch = -1.5707963267948966;
        if (zero == 2) heading = 0;
        break;
      }
      default:  // from a cell's edge or corner
        at = {std::floor(at.x()) + (uniform(0, 1) < 0.5 ? 0.5 : 0.0), std::floor(at.y()), at.z()};
        break;
    }
    Eigen::Vector3d d(std::sin(heading) * std::cos(pitch), std::cos(heading) * std::cos(pitch),
                      std::sin(pitch));
    if (kind == 1 || kind == 2 || kind == 8)
      for (int k = 0; k < 3; ++k)
        if (std::abs(d[k]) < 1e-12) d[k] = 0;
    const Eigen::Vector3d origin(frame.cell.x(), frame.cell.y(), frame.base_height_m);
    rays.push_back({at - origin - frame.start, d, 0});
  }
  return rays;
}

Agreement compare(Scene& scene, const RayFrame& frame, Surface surface, std::span<const SingleRay> rays) {
  const double length = 60000;
  const auto hits = scene.caster.cast(rays, frame, surface, length, *scene.cache, *scene.textures);
  EXPECT_TRUE(hits.has_value()) << hits.error().message;
  const ReferenceCaster reference(*scene.grid, surface);
  Agreement out;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const RayHit& hit = (*hits)[i];
    const auto expected = reference.cast(frame, rays[i].direction, length, rays[i].start);
    ++out.rays;
    out.most_steps = std::max(out.most_steps, hit.steps);
    if (hit.gave_up) ++out.gave_up;
    if (hit.found != expected.has_value()) {
      ++out.other_end;
      continue;
    }
    if (!hit.found) continue;
    ++out.hits;
    const double error = std::abs(hit.height_m - expected->height_m);
    if (error > 1e-3) ++out.beyond;
    out.worst_m = std::max(out.worst_m, error);
  }
  return out;
}

void report(Surface surface, const std::string& kind, const Agreement& a) {
  std::printf(
      "%s, kind %s: %zu rays, %zu hits, %zu end otherwise, %zu beyond 1 mm, worst %.4f m, most steps %d\n",
      std::string(surfaceName(surface)).c_str(), kind.c_str(), a.rays, a.hits, a.other_end, a.beyond,
      a.worst_m, a.most_steps);
}

}  // namespace overfly::preview
