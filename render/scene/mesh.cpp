#include "render/scene/mesh.h"

#include <cmath>
#include <map>
#include <utility>

namespace overfly::scene {
namespace {

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

bool insideTriangle(const Eigen::Vector2d& p, const Eigen::Vector2d& a, const Eigen::Vector2d& b,
                    const Eigen::Vector2d& c) {
  return cross(b - a, p - a) > 0 && cross(c - b, p - b) > 0 && cross(a - c, p - c) > 0;
}

Eigen::Vector3d raised(const Eigen::Vector2d& p, double z) { return {p.x(), p.y(), z}; }

}  // namespace

std::vector<std::uint32_t> triangulated(const std::vector<Eigen::Vector2d>& polygon) {
  std::vector<std::uint32_t> ring(polygon.size());
  for (std::uint32_t i = 0; i < ring.size(); ++i) ring[i] = i;
  std::vector<std::uint32_t> indices;
  while (ring.size() > 3) {
    std::size_t ear = ring.size();
    for (std::size_t i = 0; i < ring.size() && ear == ring.size(); ++i) {
      const std::uint32_t a = ring[(i + ring.size() - 1) % ring.size()], b = ring[i],
                          c = ring[(i + 1) % ring.size()];
      if (cross(polygon[b] - polygon[a], polygon[c] - polygon[b]) <= 0) continue;
      bool empty = true;
      for (const std::uint32_t other : ring) {
        if (other != a && other != b && other != c &&
            insideTriangle(polygon[other], polygon[a], polygon[b], polygon[c])) {
          empty = false;
          break;
        }
      }
      if (empty) ear = i;
    }
    if (ear == ring.size()) break;  // not simple: what is left stays open
    indices.insert(indices.end(),
                   {ring[(ear + ring.size() - 1) % ring.size()], ring[ear], ring[(ear + 1) % ring.size()]});
    ring.erase(ring.begin() + static_cast<std::ptrdiff_t>(ear));
  }
  if (ring.size() == 3) indices.insert(indices.end(), {ring[0], ring[1], ring[2]});
  return indices;
}

void SolidBuilder::face(const std::vector<Eigen::Vector3d>& corners, Material material,
                        const Eigen::Vector3d& uv_origin, const Eigen::Vector3d& u_axis,
                        const Eigen::Vector3d& v_axis) {
  const Eigen::Vector3f normal =
      (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized().cast<float>();
  const auto first = static_cast<std::uint32_t>(mesh_.vertices.size());
  for (const Eigen::Vector3d& corner : corners) {
    const Eigen::Vector3f p = corner.cast<float>();
    mesh_.vertices.push_back({p.x(), p.y(), p.z(), normal.x(), normal.y(), normal.z(),
                              static_cast<float>((corner - uv_origin).dot(u_axis)),
                              static_cast<float>((corner - uv_origin).dot(v_axis)),
                              static_cast<std::uint32_t>(material) | object_ << 8});
  }
  for (std::uint32_t i = 2; i < corners.size(); ++i) {
    mesh_.indices.insert(mesh_.indices.end(), {first, first + i - 1, first + i});
  }
}

void SolidBuilder::wall(const Eigen::Vector2d& a, const Eigen::Vector2d& b, double z0, double z1,
                        Material material) {
  const Eigen::Vector2d along = (b - a).normalized();
  face({raised(a, z0), raised(b, z0), raised(b, z1), raised(a, z1)}, material, raised(a, z0),
       raised(along, 0), Eigen::Vector3d::UnitZ());
}

void SolidBuilder::box(const Eigen::Vector2d& centre, const Eigen::Vector2d& size, double turn, double z0,
                       double z1, Material walls, Material top) {
  const Eigen::Rotation2Dd rotation(turn);
  const Eigen::Vector2d x = rotation * Eigen::Vector2d(0.5 * size.x(), 0),
                        y = rotation * Eigen::Vector2d(0, 0.5 * size.y());
  prism({centre - x - y, centre + x - y, centre + x + y, centre - x + y}, z0, z1, walls, top);
}

void SolidBuilder::gable(const Eigen::Vector2d& centre, const Eigen::Vector2d& size, double turn, double z0,
                         double eaves, double ridge, double overhang, Material walls, Material roof) {
  const Eigen::Rotation2Dd rotation(turn);
  const Eigen::Vector2d along = rotation * Eigen::Vector2d(1, 0), across = rotation * Eigen::Vector2d(0, 1);
  const Eigen::Vector2d x = 0.5 * size.x() * along, y = 0.5 * size.y() * across;
  const Eigen::Vector2d a = centre - x - y, b = centre + x - y, c = centre + x + y, d = centre - x + y;
  wall(a, b, z0, eaves, walls);
  wall(c, d, z0, eaves, walls);
  for (const auto& [p, q] : {std::pair(b, c), std::pair(d, a)}) {  // gable ends: five corners
    const Eigen::Vector2d middle = 0.5 * (p + q);
    face({raised(p, z0), raised(q, z0), raised(q, eaves), raised(middle, ridge), raised(p, eaves)}, walls,
         raised(p, z0), raised((q - p).normalized(), 0), Eigen::Vector3d::UnitZ());
  }
  const double slope = (ridge - eaves) / (0.5 * size.y());
  const Eigen::Vector2d ox = (0.5 * size.x() + 0.6 * overhang) * along;
  for (const double side : {-1.0, 1.0}) {
    const Eigen::Vector2d foot = side * (0.5 * size.y() + overhang) * across;
    const double foot_z = eaves - slope * overhang;
    std::vector<Eigen::Vector3d> corners = {raised(centre - ox + foot, foot_z),
                                            raised(centre + ox + foot, foot_z), raised(centre + ox, ridge),
                                            raised(centre - ox, ridge)};
    if (side > 0) corners = {corners[1], corners[0], corners[3], corners[2]};
    const Eigen::Vector3d up_slope = (corners[2] - corners[1]).normalized();
    face(corners, roof, corners[0], (corners[1] - corners[0]).normalized(), up_slope);
  }
}

void SolidBuilder::prism(const std::vector<Eigen::Vector2d>& polygon, double z0, double z1, Material walls,
                         Material top) {
  for (std::size_t i = 0; i < polygon.size(); ++i)
    wall(polygon[i], polygon[(i + 1) % polygon.size()], z0, z1, walls);
  const Eigen::Vector2d along = (polygon[1] - polygon[0]).normalized();
  const Eigen::Vector3d u = raised(along, 0), v(-along.y(), along.x(), 0);
  const std::vector<std::uint32_t> triangles = triangulated(polygon);
  for (std::size_t i = 0; i < triangles.size(); i += 3) {
    face({raised(polygon[triangles[i]], z1), raised(polygon[triangles[i + 1]], z1),
          raised(polygon[triangles[i + 2]], z1)},
         top, raised(polygon[0], z1), u, v);
  }
}

Mesh SolidBuilder::finish(double cell) && {
  chunkMesh(mesh_, cell);
  return std::move(mesh_);
}

void chunkMesh(Mesh& mesh, double cell) {
  std::map<std::pair<int, int>, std::vector<std::uint32_t>> cells;
  for (std::size_t t = 0; t < mesh.triangles(); ++t) {
    const Eigen::Vector3f middle =
        (mesh.corner(3 * t) + mesh.corner(3 * t + 1) + mesh.corner(3 * t + 2)) / 3.0f;
    auto& list = cells[{static_cast<int>(std::floor(middle.y() / cell)),
                        static_cast<int>(std::floor(middle.x() / cell))}];
    for (std::size_t k = 0; k < 3; ++k) list.push_back(mesh.indices[3 * t + k]);
  }
  mesh.indices.clear();
  mesh.chunks.clear();
  for (const auto& [key, list] : cells) {
    Chunk chunk;
    chunk.first = static_cast<std::uint32_t>(mesh.indices.size());
    chunk.count = static_cast<std::uint32_t>(list.size());
    mesh.indices.insert(mesh.indices.end(), list.begin(), list.end());
    for (const std::uint32_t index : list) {
      const Vertex& vertex = mesh.vertices[index];
      chunk.box.extend(Eigen::Vector3f(vertex.x, vertex.y, vertex.z));
    }
    mesh.chunks.push_back(chunk);
  }
}

}  // namespace overfly::scene
