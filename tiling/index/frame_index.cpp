#include "tiling/index/frame_index.h"

#include <algorithm>
#include <boost/geometry.hpp>
#include <boost/geometry/geometries/box.hpp>
#include <boost/geometry/geometries/point.hpp>
#include <boost/geometry/index/rtree.hpp>
#include <boost/iterator/function_output_iterator.hpp>
#include <cmath>
#include <map>
#include <utility>

#include "tiling/index/detail/convex.h"

namespace overfly::tiling {
namespace {

namespace bg = boost::geometry;
namespace bgi = boost::geometry::index;
using Point2 = bg::model::point<double, 2, bg::cs::cartesian>;
using Point3 = bg::model::point<double, 3, bg::cs::cartesian>;
using Box2 = bg::model::box<Point2>;
using BoostBox3 = bg::model::box<Point3>;
using Entry2 = std::pair<Box2, std::uint64_t>;
using Entry3 = std::pair<BoostBox3, std::uint64_t>;
constexpr std::size_t kNodeEntries = 16;

BoostBox3 boostBox(const geo::Box3& box) {
  return {{box.min.x(), box.min.y(), box.min.z()}, {box.max.x(), box.max.y(), box.max.z()}};
}

PlaneBox boundsOf(const std::array<Eigen::Vector2d, 4>& polygon) {
  PlaneBox box{polygon[0].x(), polygon[0].y(), polygon[0].x(), polygon[0].y()};
  for (const Eigen::Vector2d& p : polygon)
    box = {std::min(box.west, p.x()), std::min(box.north, p.y()), std::max(box.east, p.x()),
           std::max(box.south, p.y())};
  return box;
}

// What the frame can see of any surface between its assumed ground and itself: the footprint, which moves
// towards the point below the camera as the surface rises.
Box2 groundBox(const IndexedFrame& record) {
  const PlaneBox box = boundsOf(record.footprint);
  return {{std::min(box.west, record.nadir.x()), std::min(box.north, record.nadir.y())},
          {std::max(box.east, record.nadir.x()), std::max(box.south, record.nadir.y())}};
}

}  // namespace

Frustum Frustum::fromCorners(const std::array<Eigen::Vector3d, 8>& corners_in_ecef) {
  const auto& c = corners_in_ecef;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  Frustum frustum{{}, {c[0], c[0]}};
  for (const Eigen::Vector3d& corner : c) {
    centre += corner / 8;
    frustum.box.min = frustum.box.min.cwiseMin(corner);
    frustum.box.max = frustum.box.max.cwiseMax(corner);
  }
  constexpr std::size_t kFaces[6][3] = {{0, 1, 2}, {4, 5, 6}, {0, 1, 5}, {1, 2, 6}, {2, 3, 7}, {3, 0, 4}};
  for (const auto& face : kFaces) {
    Eigen::Vector3d normal = (c[face[1]] - c[face[0]]).cross(c[face[2]] - c[face[0]]).normalized();
    if (normal.dot(centre - c[face[0]]) > 0) normal = -normal;
    double offset = normal.dot(c[face[0]]);
    for (const std::size_t corner : face) offset = std::max(offset, normal.dot(c[corner]));
    frustum.planes.push_back({normal, offset});
  }
  return frustum;
}

struct FrameIndex::Trees {
  explicit Trees(const geo::TileLattice& lattice_in) : lattice(lattice_in) {}

  geo::TileLattice lattice;
  std::map<std::uint64_t, IndexedFrame> records;
  bgi::rtree<Entry3, bgi::rstar<kNodeEntries>> pyramids;
  bgi::rtree<Entry2, bgi::rstar<kNodeEntries>> grounds;
  std::optional<PlaneBox> area;
  // Over all frames that were ever near-vertical: how far a footprint's border moves outwards per metre that
  // the surface lies lower (plane units), and the highest assumed ground.
  Eigen::Vector2d max_slope = Eigen::Vector2d::Zero();
  double max_ground_height_m = -1e9;

  void account(const IndexedFrame& record) {
    if (!record.near_vertical) return;
    const PlaneBox box = boundsOf(record.footprint);
    if (!area) area = box;
    *area = {std::min(area->west, box.west), std::min(area->north, box.north), std::max(area->east, box.east),
             std::max(area->south, box.south)};
    const double above_m = std::max(record.camera_height_m - record.ground_height_m, 1e-9);
    for (const Eigen::Vector2d& corner : record.footprint)
      max_slope = max_slope.cwiseMax((corner - record.nadir).cwiseAbs() / above_m);
    max_ground_height_m = std::max(max_ground_height_m, record.ground_height_m);
  }

  void recomputeArea() {
    area.reset();
    for (const auto& [id, record] : records) account(record);
  }

  template <typename Ids>
  [[nodiscard]] std::vector<const IndexedFrame*> sorted(Ids& ids) const {
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    std::vector<const IndexedFrame*> result;
    result.reserve(ids.size());
    for (const std::uint64_t id : ids) result.push_back(&records.at(id));
    return result;
  }
};

FrameIndex::FrameIndex(const geo::TileLattice& lattice) : trees_(std::make_unique<Trees>(lattice)) {}
FrameIndex::~FrameIndex() = default;
FrameIndex::FrameIndex(FrameIndex&&) noexcept = default;
FrameIndex& FrameIndex::operator=(FrameIndex&&) noexcept = default;

void FrameIndex::insert(IndexedFrame record) {
  remove(record.id);
  const auto [it, inserted] = trees_->records.emplace(record.id, std::move(record));
  const IndexedFrame& kept = it->second;
  trees_->pyramids.insert({boostBox(kept.pyramid_in_ecef), kept.id});
  if (kept.near_vertical) trees_->grounds.insert({groundBox(kept), kept.id});
  trees_->account(kept);
}

void FrameIndex::rebuild(std::vector<IndexedFrame> records) {
  auto fresh = std::make_unique<Trees>(trees_->lattice);
  for (IndexedFrame& record : records) {
    const std::uint64_t id = record.id;
    fresh->records.insert_or_assign(id, std::move(record));
  }
  std::vector<Entry3> pyramids;
  std::vector<Entry2> grounds;
  for (const auto& [id, record] : fresh->records) {
    pyramids.emplace_back(boostBox(record.pyramid_in_ecef), id);
    if (record.near_vertical) grounds.emplace_back(groundBox(record), id);
    fresh->account(record);
  }
  fresh->pyramids = decltype(fresh->pyramids)(pyramids);
  fresh->grounds = decltype(fresh->grounds)(grounds);
  trees_ = std::move(fresh);
}

bool FrameIndex::remove(std::uint64_t id) {
  const auto it = trees_->records.find(id);
  if (it == trees_->records.end()) return false;
  const IndexedFrame& record = it->second;
  trees_->pyramids.remove({boostBox(record.pyramid_in_ecef), id});
  bool on_border = false;
  if (record.near_vertical) {
    trees_->grounds.remove({groundBox(record), id});
    const PlaneBox box = boundsOf(record.footprint);
    const PlaneBox& area = *trees_->area;
    on_border =
        box.west <= area.west || box.north <= area.north || box.east >= area.east || box.south >= area.south;
  }
  trees_->records.erase(it);
  if (on_border) trees_->recomputeArea();
  return true;
}

std::size_t FrameIndex::size() const { return trees_->records.size(); }

const IndexedFrame* FrameIndex::find(std::uint64_t id) const {
  const auto it = trees_->records.find(id);
  return it == trees_->records.end() ? nullptr : &it->second;
}

const geo::TileLattice& FrameIndex::lattice() const { return trees_->lattice; }

std::vector<const IndexedFrame*> FrameIndex::framesForTile(const geo::TileKey& key, double min_height_m,
                                                           double max_height_m) const {
  std::vector<std::uint64_t> ids;
  if (trees_->grounds.empty()) return {};
  const Eigen::Vector2d reach = trees_->max_slope * std::max(0.0, trees_->max_ground_height_m - min_height_m);
  const Eigen::Vector2d low = geo::TileLattice::planeOf(key) - reach;
  const Eigen::Vector2d high = geo::TileLattice::planeOf(key, 1, 1) + reach;
  double first_turn = 0, last_turn = 0;
  if (trees_->lattice.kind() == geo::LatticeKind::WebMercator) {
    const Box2 all = trees_->grounds.bounds();
    first_turn = std::ceil(all.min_corner().get<0>() - high.x());
    last_turn = std::floor(all.max_corner().get<0>() - low.x());
  }
  for (double turns = first_turn; turns <= last_turn; ++turns)
    trees_->grounds.query(
        bgi::intersects(Box2({low.x() + turns, low.y()}, {high.x() + turns, high.y()})) &&
            bgi::satisfies([&](const Entry2& entry) {
              return detail::meetsTile(trees_->records.at(entry.second), key, turns, min_height_m,
                                       max_height_m);
            }),
        boost::make_function_output_iterator([&](const Entry2& entry) { ids.push_back(entry.second); }));
  return trees_->sorted(ids);
}

std::vector<const IndexedFrame*> FrameIndex::framesInBox(const geo::Box3& box_in_ecef) const {
  std::vector<std::uint64_t> ids;
  trees_->pyramids.query(
      bgi::intersects(boostBox(box_in_ecef)),
      boost::make_function_output_iterator([&](const Entry3& entry) { ids.push_back(entry.second); }));
  return trees_->sorted(ids);
}

std::vector<const IndexedFrame*> FrameIndex::framesInFrustum(const Frustum& frustum) const {
  auto frames = framesInBox(frustum.box);
  std::erase_if(frames, [&](const IndexedFrame* frame) {
    return std::any_of(frustum.planes.begin(), frustum.planes.end(), [&](const Frustum::Plane& plane) {
      return plane.normal.dot(frame->pose.position_in_ecef) > plane.offset &&
             std::all_of(frame->base_in_ecef.begin(), frame->base_in_ecef.end(),
                         [&](const Eigen::Vector3d& p) { return plane.normal.dot(p) > plane.offset; });
    });
  });
  return frames;
}

std::vector<const IndexedFrame*> FrameIndex::all() const {
  std::vector<const IndexedFrame*> frames;
  frames.reserve(trees_->records.size());
  for (const auto& [id, record] : trees_->records) frames.push_back(&record);
  return frames;
}

std::optional<PlaneBox> FrameIndex::area() const { return trees_->area; }

std::vector<geo::TileKey> FrameIndex::tilesUnder(const IndexedFrame& record, int zoom) {
  std::vector<geo::TileKey> keys;
  if (!record.near_vertical) return keys;
  const PlaneBox box = boundsOf(record.footprint);
  const geo::TileKey first = geo::TileLattice::keyAt({box.west, box.north}, zoom);
  const geo::TileKey last = geo::TileLattice::keyAt({box.east, box.south}, zoom);
  for (std::int64_t x = first.x; x <= last.x; ++x)
    for (std::int64_t y = first.y; y <= last.y; ++y)
      if (const geo::TileKey key{zoom, x, y};
          detail::meetsTile(record, key, 0, record.ground_height_m, record.ground_height_m))
        keys.push_back(key);
  return keys;
}

}  // namespace overfly::tiling
