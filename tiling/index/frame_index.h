#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "capture/geo/footprint.h"
#include "capture/geo/tile_lattice.h"
#include "tiling/index/indexed_frame.h"
#include "tiling/plane_box.h"

namespace overfly::tiling {

// A convex view volume in ECEF by its outward planes: a point p is inside when normal.dot(p) <= offset for
// all.
struct Frustum {
  struct Plane {
    Eigen::Vector3d normal;
    double offset;
  };
  std::vector<Plane> planes;
  geo::Box3 box;  // of the volume
  // From eight corners: near plane (top-left, top-right, bottom-right, bottom-left), then far plane likewise.
  [[nodiscard]] static Frustum fromCorners(const std::array<Eigen::Vector3d, 8>& corners_in_ecef);
};

// Which frames see a place: two R*-trees (thesis, 3.2.3; Boost.Geometry), one over the ECEF boxes of all view
// pyramids (no zone edge, antimeridian or pole in ECEF), one over the ground boxes of the near-vertical
// frames in lattice plane coordinates. Every result is in ascending order of id and depends on the set of
// frames alone. Pointers into the index hold until that frame is removed or replaced. Thread rule: const
// methods from any number of threads while nobody changes it; else externally locked.
class FrameIndex {
 public:
  explicit FrameIndex(const geo::TileLattice& lattice);
  ~FrameIndex();
  FrameIndex(FrameIndex&&) noexcept;
  FrameIndex& operator=(FrameIndex&&) noexcept;

  // Inserts, or replaces the frame of the same id (its pose was corrected).
  void insert(IndexedFrame record);
  // Many at once (at start, from the store): packed, faster than one by one; replaces all that was there.
  void rebuild(std::vector<IndexedFrame> records);
  // False when there is none of that id.
  bool remove(std::uint64_t id);

  [[nodiscard]] std::size_t size() const;
  [[nodiscard]] const IndexedFrame* find(std::uint64_t id) const;
  [[nodiscard]] const geo::TileLattice& lattice() const;

  // Near-vertical frames whose view meets the tile for some surface between the two ellipsoidal heights.
  // For Web Mercator any copy of the tile's x finds the same frames.
  [[nodiscard]] std::vector<const IndexedFrame*> framesForTile(const geo::TileKey& key, double min_height_m,
                                                               double max_height_m) const;
  // All frames whose view pyramid's box meets the box (ECEF).
  [[nodiscard]] std::vector<const IndexedFrame*> framesInBox(const geo::Box3& box_in_ecef) const;
  // All frames whose view pyramid meets the frustum; never misses one, and may include one that passes close
  // by an edge of it (only the frustum's planes are tried as separating planes).
  [[nodiscard]] std::vector<const IndexedFrame*> framesInFrustum(const Frustum& frustum) const;
  [[nodiscard]] std::vector<const IndexedFrame*> all() const;

  // The map's area A (3.2.4): the bounding rectangle of the near-vertical frames' footprints; nullopt
  // without.
  [[nodiscard]] std::optional<PlaneBox> area() const;

  // Tiles at a zoom that a frame's footprint overlaps (figure 3.10's index range, then the polygon itself),
  // in ascending order.
  [[nodiscard]] static std::vector<geo::TileKey> tilesUnder(const IndexedFrame& record, int zoom);

 private:
  struct Trees;
  std::unique_ptr<Trees> trees_;
};

}  // namespace overfly::tiling
