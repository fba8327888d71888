#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "config/error.h"
#include "daemon/link/detail/map_view.h"
#include "daemon/link/detail/raster.h"

// How often the ground has been seen, from the frames' footprints, and what of a planned area is still to be
// seen. Footprints are quadrilaterals on level ground, so this is known the moment a frame arrives; what the
// map made of it is the quality layer's. Pure functions, plane coordinates.
namespace overfly::link {

using Quad = std::array<Eigen::Vector2d, 4>;  // convex, any orientation

// Closed rings without the repeated last point; even-odd over all of them (holes and islands alike).
struct PlannedArea {
  std::vector<std::vector<Eigen::Vector2d>> rings;
};

// Polygon, MultiPolygon, Feature or FeatureCollection; what else is in there is passed over. BadInput with
// the reason: not JSON, no polygon, a coordinate outside the world, more than 20,000 points.
[[nodiscard]] Result<PlannedArea> parsePlan(const std::string& geojson, const geo::TileLattice& lattice);

// Views of every cell of a grid, rows north to south.
struct ViewGrid {
  tiling::PlaneBox box;
  int width = 0, height = 0;
  std::vector<std::uint16_t> views;
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  }
};
[[nodiscard]] ViewGrid countViews(const tiling::PlaneBox& box, int width, int height,
                                  std::span<const Quad> quads);

// Cells whose centre lies inside the area.
[[nodiscard]] std::vector<bool> insideArea(const PlannedArea& area, const ViewGrid& grid);

// Outlines of the set cells as rings of grid corners: outer rings clockwise as seen on a map whose y grows
// south, each followed by its holes.
struct Outline {
  std::vector<Eigen::Vector2i> outer;
  std::vector<std::vector<Eigen::Vector2i>> holes;
};
[[nodiscard]] std::vector<Outline> outlines(const std::vector<bool>& set, int width, int height);

struct CoverageReport {
  bool planned = false;
  double area_m2 = 0;                    // of the plan, or of what has been seen where there is none
  std::vector<double> area_by_views_m2;  // [n]: inside the plan, seen at least n times; n = 0..5
  int min_views = 3;
  double covered = 0;        // share with at least min_views, 0..1
  std::string gaps_geojson;  // MultiPolygon feature collection, cells below min_views
};
[[nodiscard]] CoverageReport reportCoverage(const PlannedArea* plan, std::span<const Quad> quads,
                                            int min_views, const geo::TileLattice& lattice);
[[nodiscard]] std::string coverageJson(const CoverageReport& report);

// 0 views: transparent, 1 red, 2 orange, 3 yellow, 4 and more green.
[[nodiscard]] Rgba coverageColours(const ViewGrid& grid);

}  // namespace overfly::link
