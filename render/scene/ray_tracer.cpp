#include "render/scene/ray_tracer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

namespace overfly::scene {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kNear = 0.05, kFar = 1e5;       // metres
constexpr glsl::vec3 kSky(0.62f, 0.72f, 0.82f);  // encoded; as GeometryPass clears
constexpr int kMostTaps = 4;                     // of the anisotropic filter, as in shaders/surface.glsl

glsl::vec3 narrow(const Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

// The rasteriser's four sample places within a pixel (the usual rotated grid).
constexpr std::array<std::array<double, 2>, 4> kSamples = {
    {{0.375, 0.125}, {0.875, 0.375}, {0.125, 0.625}, {0.625, 0.875}}};

// Where the ray through the pixel place meets the facet's plane.
Vector3d onPlane(const Facet& facet, const Ray& ray) {
  const double along = ray.direction.dot(facet.normal);
  return ray.origin + (facet.point - ray.origin).dot(facet.normal) / along * ray.direction;
}

std::uint8_t byteOf(float value) {
  return static_cast<std::uint8_t>(std::lround(255.0f * std::clamp(value, 0.0f, 1.0f)));
}

}  // namespace

glsl::vec3 Shader::colour(const Hit& hit, const Vector3d& point, const Vector3d& dx,
                          const Vector3d& dy) const {
  const World& world = geometry.world();
  Eigen::Vector3f normal;
  std::function<glsl::vec3(glsl::vec2, float)> albedo;
  Vector2d at, ax, ay;  // place and footprint in the surface's own coordinates, metres
  if (hit.kind == Hit::Kind::Leaf) {
    const Geometry::Leaf leaf = geometry.leafOf(hit.primitive / 32, hit.primitive % 32);
    normal = leaf.normal;
    const double u2 = leaf.u_axis.squaredNorm(), v2 = leaf.v_axis.squaredNorm();
    const auto local = [&](const Vector3d& v) {
      return Vector2d(v.dot(leaf.u_axis) / u2, v.dot(leaf.v_axis) / v2);
    };
    at = local(point - leaf.centre);
    ax = local(dx) * leaf.metres;
    ay = local(dy) * leaf.metres;
    const amplify::Plant& plant = world.plants[hit.primitive / 32];
    const auto depth = static_cast<float>((point.z() - plant.up) / plant.height);
    const float width = static_cast<float>(std::max(ax.norm(), ay.norm()));
    const glsl::vec3 leaf_albedo =
        Appearance::leaf(plant.species, plant.seed, {static_cast<float>(at.x()), static_cast<float>(at.y())},
                         leaf.metres, std::clamp(depth, 0.0f, 1.0f), width, leaf.clump);
    albedo = [leaf_albedo](glsl::vec2, float) { return leaf_albedo; };
  } else {
    const Mesh& mesh = hit.kind == Hit::Kind::Ground ? world.ground : world.solids;
    const Vector3d a = mesh.corner(3 * hit.primitive).cast<double>();
    const Vector3d e1 = mesh.corner(3 * hit.primitive + 1).cast<double>() - a;
    const Vector3d e2 = mesh.corner(3 * hit.primitive + 2).cast<double>() - a;
    const double d11 = e1.dot(e1), d12 = e1.dot(e2), d22 = e2.dot(e2), determinant = d11 * d22 - d12 * d12;
    const auto weights = [&](const Vector3d& p) {
      const double p1 = p.dot(e1), p2 = p.dot(e2);
      return Vector2d((d22 * p1 - d12 * p2) / determinant, (d11 * p2 - d12 * p1) / determinant);
    };
    const Vertex& va = mesh.vertices[mesh.indices[3 * hit.primitive]];
    const Vertex& vb = mesh.vertices[mesh.indices[3 * hit.primitive + 1]];
    const Vertex& vc = mesh.vertices[mesh.indices[3 * hit.primitive + 2]];
    if (hit.kind == Hit::Kind::Ground) {
      const Vector2d w = weights(point - a);
      const auto mixed = [&](float p, float q, float r) {
        return p + static_cast<float>(w.x()) * (q - p) + static_cast<float>(w.y()) * (r - p);
      };
      normal =
          Eigen::Vector3f(mixed(va.nx, vb.nx, vc.nx), mixed(va.ny, vb.ny, vc.ny), mixed(va.nz, vb.nz, vc.nz))
              .normalized();
      at = point.head<2>();
      ax = dx.head<2>();
      ay = dy.head<2>();
      albedo = [this](glsl::vec2 p, float width) { return appearance.ground(p, width); };
    } else {
      normal = {va.nx, va.ny, va.nz};
      const Vector2d uv1(vb.u - va.u, vb.v - va.v), uv2(vc.u - va.u, vc.v - va.v);
      const auto uv = [&](const Vector3d& p) {
        const Vector2d w = weights(p);
        return Vector2d(w.x() * uv1 + w.y() * uv2);
      };
      at = Vector2d(va.u, va.v) + uv(point - a);
      ax = uv(dx);
      ay = uv(dy);
      const std::uint32_t surface = va.surface;
      albedo = [this, surface](glsl::vec2 p, float width) { return appearance.solid(surface, p, width); };
    }
  }
  // Anisotropic: taps along the longer side of the footprint, each filtered over its share or the shorter
  // side.
  const Vector2d longer = ax.squaredNorm() >= ay.squaredNorm() ? ax : ay,
                 shorter = ax.squaredNorm() >= ay.squaredNorm() ? ay : ax;
  const double ratio = longer.norm() / std::max(shorter.norm(), 1e-9);
  const int taps = std::clamp(static_cast<int>(ratio + 0.25), 1, kMostTaps);
  const auto width = static_cast<float>(std::max(longer.norm() / taps, shorter.norm()));
  glsl::vec3 sum(0.0f);
  for (int i = 0; i < taps; ++i) {
    const Vector2d p = at + ((i + 0.5) / taps - 0.5) * longer;
    sum = sum + albedo({static_cast<float>(p.x()), static_cast<float>(p.y())}, width);
  }
  float lit = 1;
  if (shadows) {
    const Ray ray{point + 0.02 * normal.cast<double>(), world.towards_sun};
    lit = geometry.blocked(ray, 0.03, kFar) ? 0.0f : 1.0f;
  }
  const glsl::vec3 n(normal.x(), normal.y(), normal.z());
  return Appearance::encoded(
      Appearance::radiance(sum * (1.0f / static_cast<float>(taps)), n, narrow(world.towards_sun), lit));
}

namespace {

Picture trace(const Geometry& geometry, const capture::CameraModel& camera,
              const std::function<CameraState(double row)>& stateOf, const TraceOptions& options) {
  const World& world = geometry.world();
  const Appearance appearance(world.cover, world.description.pavement, world.description.street_lines);
  const Shader shader{geometry, appearance, options.shadows};
  Picture picture{camera.width, camera.height, {}};
  picture.rgb.resize(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height) * 3);
  for (int y = 0; y < camera.height; ++y) {
    const CameraState state = stateOf(y + 0.5);
    const auto rayAt = [&](double px, double py) {
      const Vector3d direction = camera.unproject({px, py}).value_or(Vector3d(0, 0, 1));
      return Ray{state.position, state.enu_from_camera * (direction / direction.z())};
    };
    for (int x = 0; x < camera.width; ++x) {
      const Ray centre = rayAt(x + 0.5, y + 0.5), right = rayAt(x + 1.5, y + 0.5),
                below = rayAt(x + 0.5, y + 1.5);
      glsl::vec3 sum(0.0f);
      std::array<std::optional<Hit>, 4> hits;
      std::array<glsl::vec3, 4> colours;
      for (int s = 0; s < options.samples; ++s) {
        const auto i = static_cast<std::size_t>(s);
        const Ray ray = options.samples == 1 ? centre : rayAt(x + kSamples[i][0], y + kSamples[i][1]);
        hits[i] = geometry.firstHit(ray, kNear, kFar);
        if (!hits[i]) {
          sum = sum + kSky;
          continue;
        }
        // A primitive is shaded once a pixel, at its centre, as a rasteriser with multi-sampling does.
        bool known = false;
        for (std::size_t k = 0; k < i && !known; ++k) {
          known = hits[k] && hits[k]->kind == hits[i]->kind && hits[k]->primitive == hits[i]->primitive;
          if (known) colours[i] = colours[k];
        }
        if (!known) {
          const Facet facet = geometry.facetOf(*hits[i]);
          const Vector3d point = onPlane(facet, centre);
          colours[i] =
              shader.colour(*hits[i], point, onPlane(facet, right) - point, onPlane(facet, below) - point);
        }
        sum = sum + colours[i];
      }
      const glsl::vec3 mean = sum * (1.0f / static_cast<float>(options.samples));
      const std::size_t at = 3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(camera.width) +
                                  static_cast<std::size_t>(x));
      picture.rgb[at] = byteOf(mean.x);
      picture.rgb[at + 1] = byteOf(mean.y);
      picture.rgb[at + 2] = byteOf(mean.z);
    }
  }
  return picture;
}

}  // namespace

Picture tracePicture(const Geometry& geometry, const capture::CameraModel& camera, const FlightPath& path,
                     double time_s, const TraceOptions& options) {
  return trace(
      geometry, camera,
      [&](double row) { return path.at(time_s + (row - 0.5 * camera.height) * options.line_time_s); },
      options);
}

Picture tracePicture(const Geometry& geometry, const capture::CameraModel& camera, const CameraState& state,
                     const TraceOptions& options) {
  return trace(
      geometry, camera, [&](double) { return state; }, options);
}

std::vector<double> traceDepth(const Geometry& geometry, const capture::CameraModel& camera,
                               const CameraState& state) {
  std::vector<double> depth(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height),
                            0.0);
  std::size_t at = 0;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x, ++at) {
      const std::optional<Vector3d> direction = camera.unproject({x + 0.5, y + 0.5});
      if (!direction || direction->z() <= 0) continue;
      const Ray ray{state.position, state.enu_from_camera * (*direction / direction->z())};
      if (const std::optional<Hit> hit = geometry.firstHit(ray, kNear, kFar)) depth[at] = hit->distance;
    }
  }
  return depth;
}

}  // namespace overfly::scene
