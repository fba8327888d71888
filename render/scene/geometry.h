#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "render/scene/foliage.h"
#include "render/scene/world.h"

namespace overfly::scene {

struct Ray {
  Eigen::Vector3d origin;     // scene ENU, metres
  Eigen::Vector3d direction;  // any length; distances are in its units
};

// What a ray meets first.
struct Hit {
  enum class Kind { Ground, Solid, Leaf };
  double distance = 0;  // in units of the ray's direction
  Kind kind = Kind::Ground;
  std::uint32_t primitive = 0;  // triangle of the ground or the solids; for leaves plant * 32 + polygon
};

// The plane of a primitive with what the shading needs, so that a pixel can be shaded away from the hit too,
// as a rasteriser does.
struct Facet {
  Eigen::Vector3d point;
  Eigen::Vector3d normal;  // geometric, unit, upward or outward
};

// A bounding-volume hierarchy over the world's triangles and plants: exact visibility in double on the CPU.
// Borrows the world. Immutable; reentrant.
class Geometry {
 public:
  explicit Geometry(const World& world);

  // First hit with least < distance < most.
  [[nodiscard]] std::optional<Hit> firstHit(const Ray& ray, double least, double most) const;
  [[nodiscard]] bool blocked(const Ray& ray, double least, double most) const;
  [[nodiscard]] const World& world() const { return world_; }

  [[nodiscard]] Facet facetOf(const Hit& hit) const;

  // A foliage polygon in scene ENU.
  struct Leaf {
    Eigen::Vector3d centre, u_axis, v_axis;
    Eigen::Vector3f normal;  // for the light
    float metres = 1;        // half side, for the size of leaves
    float depth = 0;         // 0 bottom, 1 top of the crown: at the polygon's centre
    std::uint32_t clump = 0;
  };
  [[nodiscard]] Leaf leafOf(std::uint32_t plant, std::uint32_t polygon) const;

 private:
  struct Node {
    Eigen::Vector3f low, high;
    std::uint32_t first = 0;  // child (left = first, right = first + 1) or first primitive
    std::uint32_t count = 0;  // 0: inner node
  };
  struct Primitive {
    Hit::Kind kind;
    std::uint32_t index;  // triangle or plant
  };
  void build();
  void intersect(const Primitive& primitive, const Ray& ray, double least, Hit& best, bool& found) const;

  const World& world_;
  std::vector<FoliagePolygon> foliage_[4];
  std::vector<Primitive> primitives_;
  std::vector<Node> nodes_;
};

}  // namespace overfly::scene
