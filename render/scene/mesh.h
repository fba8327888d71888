#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "render/scene/description.h"

namespace overfly::scene {

// A corner of a triangle; the layout is that of the GPU's vertex buffer. Scene ENU, metres, float32: the
// scene is at most 20 km wide, the triangles are what they are, truth included.
struct Vertex {
  float x = 0, y = 0, z = 0;
  float nx = 0, ny = 0, nz = 1;  // unit normal for the light
  float u = 0, v = 0;            // metres on the face (solids)
  std::uint32_t surface = 0;     // material in the low 8 bits, number of the object above (solids)
};
static_assert(sizeof(Vertex) == 36);

// A run of a mesh's indices with its bounds: the unit of culling.
struct Chunk {
  Eigen::AlignedBox3f box;
  std::uint32_t first = 0;  // index
  std::uint32_t count = 0;  // indices
};

struct Mesh {
  std::vector<Vertex> vertices;
  std::vector<std::uint32_t> indices;
  std::vector<Chunk> chunks;

  [[nodiscard]] std::size_t triangles() const { return indices.size() / 3; }
  [[nodiscard]] Eigen::Vector3f corner(std::size_t index) const {
    const Vertex& vertex = vertices[indices[index]];
    return {vertex.x, vertex.y, vertex.z};
  }
};

// Builds solids face by face. Faces are planar polygons, counter-clockwise seen from outside.
class SolidBuilder {
 public:
  // Numbers the object that the following faces belong to; it picks the tone.
  void beginObject(std::uint32_t number) { object_ = number; }

  // A convex face; u runs along `u_axis` (unit), v along `v_axis`, both counted from `uv_origin`.
  void face(const std::vector<Eigen::Vector3d>& corners, Material material, const Eigen::Vector3d& uv_origin,
            const Eigen::Vector3d& u_axis, const Eigen::Vector3d& v_axis);

  // A vertical wall over the segment a -> b (outside to its right), v counted from z0.
  void wall(const Eigen::Vector2d& a, const Eigen::Vector2d& b, double z0, double z1, Material material);

  // A box over a turned rectangle: centre, size along the turned axes, between two heights. No bottom.
  void box(const Eigen::Vector2d& centre, const Eigen::Vector2d& size, double turn, double z0, double z1,
           Material walls, Material top);

  // A gabled house: ridge along the first axis, roof beyond the walls by `overhang`.
  void gable(const Eigen::Vector2d& centre, const Eigen::Vector2d& size, double turn, double z0, double eaves,
             double ridge, double overhang, Material walls, Material roof);

  // Walls and a flat top over a simple counter-clockwise polygon.
  void prism(const std::vector<Eigen::Vector2d>& polygon, double z0, double z1, Material walls, Material top);

  // The mesh, its triangles sorted into chunks of `cell` metres on the ground.
  [[nodiscard]] Mesh finish(double cell) &&;

 private:
  std::uint32_t object_ = 0;
  Mesh mesh_;
};

// Indices of the triangles of a simple counter-clockwise polygon (ear clipping).
[[nodiscard]] std::vector<std::uint32_t> triangulated(const std::vector<Eigen::Vector2d>& polygon);

// Sorts a mesh's triangles into chunks of `cell` metres on the ground, keeping their order within a chunk.
void chunkMesh(Mesh& mesh, double cell);

}  // namespace overfly::scene
