#pragma once
#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "tiling/index/indexed_frame.h"

// Small convex polygons in the plane. Coordinates should be near 0 and of ordinary size (tile units): plane
// coordinates of a footprint differ in the seventh digit only.
namespace overfly::tiling::detail {

using Polygon = std::vector<Eigen::Vector2d>;

// Area by equation (5.7), of a polygon in either direction of turning.
[[nodiscard]] double area(std::span<const Eigen::Vector2d> polygon);

// Intersection of two convex polygons (Sutherland-Hodgman), either direction of turning; empty when disjoint.
[[nodiscard]] Polygon intersection(std::span<const Eigen::Vector2d> subject,
                                   std::span<const Eigen::Vector2d> clip);

// Inside or on the border of a convex polygon.
[[nodiscard]] bool contains(std::span<const Eigen::Vector2d> polygon, const Eigen::Vector2d& point);

// True when some of the axes separates the two point sets (with a gap).
[[nodiscard]] bool separated(std::span<const Eigen::Vector2d> a, std::span<const Eigen::Vector2d> b,
                             std::span<const Eigen::Vector2d> axes);

// The frame's footprint at a height in units of tiles at the key's zoom, (0, 0) the tile's north-west corner.
// `turns` whole turns of the world are subtracted from px.
[[nodiscard]] std::array<Eigen::Vector2d, 4> footprintInTile(const IndexedFrame& record, double height_m,
                                                             const geo::TileKey& key, double turns = 0);

// How often the world's width lies between the footprint and the tile (Web Mercator; else 0).
[[nodiscard]] double turnsBetween(const IndexedFrame& record, const geo::TileKey& key,
                                  const geo::TileLattice& lattice);

// Whether the frame's view meets the tile's area for some surface height in the range.
[[nodiscard]] bool meetsTile(const IndexedFrame& record, const geo::TileKey& key, double turns,
                             double min_height_m, double max_height_m);

}  // namespace overfly::tiling::detail
