#include "daemon/link/detail/coverage.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>

namespace overfly::link {
namespace {

using nlohmann::json;
constexpr std::size_t kLargestPlan = 20000;
constexpr int kGridSide = 512;
constexpr int kCountedViews = 5;

bool addRing(const json& ring, const geo::TileLattice& lattice, PlannedArea& area, std::size_t& points) {
  if (!ring.is_array() || ring.size() < 4) return false;
  std::vector<Eigen::Vector2d> out;
  for (const auto& point : ring) {
    if (!point.is_array() || point.size() < 2 || !point[0].is_number() || !point[1].is_number()) return false;
    const double lon = point[0].get<double>(), lat = point[1].get<double>();
    if (!(std::abs(lon) <= 360) || !(std::abs(lat) <= 85) || ++points > kLargestPlan) return false;
    const double near = area.rings.empty() && out.empty() ? 0.5
                        : out.empty()                     ? area.rings.front().front().x()
                                                          : out.front().x();
    const auto plane = lattice.planeFromGeodetic(geo::radians(lat), geo::radians(lon), near);
    if (!plane) return false;
    out.push_back(*plane);
  }
  if (out.front() == out.back()) out.pop_back();
  area.rings.push_back(std::move(out));
  return true;
}

// False only for a polygon that is there and wrong.
bool addGeometry(const json& node, const geo::TileLattice& lattice, PlannedArea& area, std::size_t& points,
                 int depth) {
  if (!node.is_object() || depth > 8) return true;
  const auto type =
      node.contains("type") && node["type"].is_string() ? node["type"].get<std::string>() : std::string();
  const auto each = [&](const char* name, auto visit) {
    if (!node.contains(name) || !node[name].is_array()) return true;
    return std::ranges::all_of(node[name], visit);
  };
  const auto ring = [&](const json& r) { return addRing(r, lattice, area, points); };
  const auto inner = [&](const json& n) { return addGeometry(n, lattice, area, points, depth + 1); };
  if (type == "Polygon") return each("coordinates", ring);
  if (type == "MultiPolygon")
    return each("coordinates", [&](const json& polygon) {
      return polygon.is_array() && std::ranges::all_of(polygon, ring);
    });
  if (type == "FeatureCollection") return each("features", inner);
  if (type == "GeometryCollection") return each("geometries", inner);
  if (type == "Feature" && node.contains("geometry")) return inner(node["geometry"]);
  return true;
}

tiling::PlaneBox boxOf(std::span<const Eigen::Vector2d> points, tiling::PlaneBox box) {
  for (const auto& p : points) {
    box.west = std::min(box.west, p.x());
    box.east = std::max(box.east, p.x());
    box.north = std::min(box.north, p.y());
    box.south = std::max(box.south, p.y());
  }
  return box;
}

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr tiling::PlaneBox kNoBox{kInfinity, kInfinity, -kInfinity, -kInfinity};

}  // namespace

Result<PlannedArea> parsePlan(const std::string& geojson, const geo::TileLattice& lattice) {
  const auto node = json::parse(geojson, nullptr, false);
  if (node.is_discarded()) return fail(ErrorCode::BadInput, "the plan is not JSON");
  PlannedArea area;
  std::size_t points = 0;
  if (!addGeometry(node, lattice, area, points, 0))
    return fail(ErrorCode::BadInput,
                "the plan holds a ring that is not at least four [lon, lat] pairs in degrees, "
                "or more than 20,000 points");
  if (area.rings.empty()) return fail(ErrorCode::BadInput, "the plan holds no GeoJSON polygon");
  return area;
}

ViewGrid countViews(const tiling::PlaneBox& box, int width, int height, std::span<const Quad> quads) {
  ViewGrid grid{
      box, width, height,
      std::vector<std::uint16_t>(static_cast<std::size_t>(width) * static_cast<std::size_t>(height))};
  const double sx = width / (box.east - box.west), sy = height / (box.south - box.north);
  for (const auto& quad : quads) {
    const auto bounds = boxOf(quad, kNoBox);
    if (!bounds.intersects(box)) continue;
    const int top = std::max(0, static_cast<int>(std::floor((bounds.north - box.north) * sy)));
    const int bottom = std::min(height - 1, static_cast<int>(std::floor((bounds.south - box.north) * sy)));
    for (int y = top; y <= bottom; ++y) {
      // the convex quadrilateral's span on the row through the cells' centres
      const double row = box.north + (y + 0.5) / sy;
      double from = kInfinity, to = -kInfinity;
      for (std::size_t i = 0; i < 4; ++i) {
        const auto &a = quad[i], &b = quad[(i + 1) % 4];
        if ((a.y() <= row) == (b.y() <= row)) continue;
        const double x = a.x() + (row - a.y()) / (b.y() - a.y()) * (b.x() - a.x());
        from = std::min(from, x);
        to = std::max(to, x);
      }
      if (from > to) continue;
      const int left = std::max(0, static_cast<int>(std::ceil((from - box.west) * sx - 0.5)));
      const int right = std::min(width - 1, static_cast<int>(std::floor((to - box.west) * sx - 0.5)));
      for (int x = left; x <= right; ++x) {
        auto& views = grid.views[grid.index(x, y)];
        if (views < UINT16_MAX) ++views;
      }
    }
  }
  return grid;
}

std::vector<bool> insideArea(const PlannedArea& area, const ViewGrid& grid) {
  std::vector<bool> out(grid.views.size());
  const double sx = grid.width / (grid.box.east - grid.box.west),
               sy = grid.height / (grid.box.south - grid.box.north);
  std::vector<double> crossings;
  for (int y = 0; y < grid.height; ++y) {
    const double row = grid.box.north + (y + 0.5) / sy;
    crossings.clear();
    for (const auto& ring : area.rings)
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const auto &a = ring[i], &b = ring[(i + 1) % ring.size()];
        if ((a.y() <= row) == (b.y() <= row)) continue;
        crossings.push_back(a.x() + (row - a.y()) / (b.y() - a.y()) * (b.x() - a.x()));
      }
    std::ranges::sort(crossings);
    for (std::size_t i = 0; i + 1 < crossings.size(); i += 2) {
      const int left = std::max(0, static_cast<int>(std::ceil((crossings[i] - grid.box.west) * sx - 0.5)));
      const int right = std::min(grid.width - 1,
                                 static_cast<int>(std::floor((crossings[i + 1] - grid.box.west) * sx - 0.5)));
      for (int x = left; x <= right; ++x) out[grid.index(x, y)] = true;
    }
  }
  return out;
}

std::vector<Outline> outlines(const std::vector<bool>& set, int width, int height) {
  const auto at = [&](int x, int y) {
    return x >= 0 && y >= 0 && x < width && y < height &&
           set[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)];
  };
  // Directed edges with the set cell on their right (y south): from corner to corner. Where two cells touch
  // at a corner only, two edges leave it; the sharper right turn keeps the cells apart.
  using Corner = std::pair<int, int>;  // y, x
  std::map<Corner, std::vector<Corner>> edges;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      if (!at(x, y)) continue;
      if (!at(x, y - 1)) edges[{y, x}].push_back({y, x + 1});
      if (!at(x + 1, y)) edges[{y, x + 1}].push_back({y + 1, x + 1});
      if (!at(x, y + 1)) edges[{y + 1, x + 1}].push_back({y + 1, x});
      if (!at(x - 1, y)) edges[{y + 1, x}].push_back({y, x});
    }
  std::vector<std::vector<Eigen::Vector2i>> rings;
  while (!edges.empty()) {
    const auto start = edges.begin()->first;
    std::vector<Eigen::Vector2i> ring;
    Corner here = start;
    Eigen::Vector2i direction(0, 0);
    do {
      auto it = edges.find(here);
      auto& out = it->second;
      std::size_t pick = 0;
      if (out.size() > 1) {
        const Eigen::Vector2i right(-direction.y(), direction.x());
        for (std::size_t i = 0; i < out.size(); ++i)
          if (Eigen::Vector2i(out[i].second - here.second, out[i].first - here.first) == right) pick = i;
      }
      const auto next = out[pick];
      out.erase(out.begin() + static_cast<std::ptrdiff_t>(pick));
      if (out.empty()) edges.erase(it);
      const Eigen::Vector2i step(next.second - here.second, next.first - here.first);
      if (step != direction) ring.emplace_back(here.second, here.first);
      direction = step;
      here = next;
    } while (here != start);
    rings.push_back(std::move(ring));
  }
  const auto signedArea = [](const std::vector<Eigen::Vector2i>& ring) {
    std::int64_t sum = 0;
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const auto &a = ring[i], &b = ring[(i + 1) % ring.size()];
      sum += std::int64_t{a.x()} * b.y() - std::int64_t{b.x()} * a.y();
    }
    return sum;
  };
  std::vector<Outline> out;
  for (auto& ring : rings)
    if (signedArea(ring) > 0) out.push_back({ring, {}});
  for (auto& ring : rings) {
    if (signedArea(ring) >= 0) continue;
    // A point of the set just beside the hole's first edge tells which outline it is in.
    const Eigen::Vector2d inside = ring[0].cast<double>() + Eigen::Vector2d(-0.25, -0.25);
    Outline* owner = nullptr;
    std::int64_t owner_area = 0;
    for (auto& outline : out) {
      bool in = false;
      for (std::size_t i = 0; i < outline.outer.size(); ++i) {
        const Eigen::Vector2d a = outline.outer[i].cast<double>(),
                              b = outline.outer[(i + 1) % outline.outer.size()].cast<double>();
        if ((a.y() <= inside.y()) == (b.y() <= inside.y())) continue;
        if (inside.x() < a.x() + (inside.y() - a.y()) / (b.y() - a.y()) * (b.x() - a.x())) in = !in;
      }
      const auto area = signedArea(outline.outer);
      if (in && (!owner || area < owner_area)) {
        owner = &outline;
        owner_area = area;
      }
    }
    if (owner) owner->holes.push_back(ring);
  }
  return out;
}

CoverageReport reportCoverage(const PlannedArea* plan, std::span<const Quad> quads, int min_views,
                              const geo::TileLattice& lattice) {
  CoverageReport report;
  report.planned = plan != nullptr;
  report.min_views = min_views;
  report.area_by_views_m2.assign(kCountedViews + 1, 0.0);
  auto box = kNoBox;
  if (plan)
    for (const auto& ring : plan->rings) box = boxOf(ring, box);
  else
    for (const auto& quad : quads) box = boxOf(quad, box);
  auto gaps = json{{"type", "FeatureCollection"}, {"features", json::array()}};
  if (box.west < box.east && box.north < box.south) {
    const double cell = std::max(box.east - box.west, box.south - box.north) / kGridSide;
    const int width = std::max(1, static_cast<int>(std::ceil((box.east - box.west) / cell)));
    const int height = std::max(1, static_cast<int>(std::ceil((box.south - box.north) / cell)));
    box.east = box.west + width * cell;
    box.south = box.north + height * cell;
    const auto grid = countViews(box, width, height, quads);
    const auto inside = plan ? insideArea(*plan, grid) : std::vector<bool>(grid.views.size(), true);
    const auto middle =
        lattice.geodeticFromPlane({0.5 * (box.west + box.east), 0.5 * (box.north + box.south)});
    const double cell_m = cell * lattice.metresPerPlaneUnit(middle.lat, middle.lon);
    std::vector<bool> gap(grid.views.size());
    for (std::size_t i = 0; i < gap.size(); ++i) {
      if (!inside[i] || (!plan && grid.views[i] == 0)) continue;
      for (int n = 0; n <= std::min<int>(kCountedViews, grid.views[i]); ++n)
        report.area_by_views_m2[static_cast<std::size_t>(n)] += cell_m * cell_m;
      if (grid.views[i] >= min_views) {
        report.covered += cell_m * cell_m;
      } else {
        gap[i] = true;
      }
    }
    report.area_m2 = report.area_by_views_m2[0];
    if (report.area_m2 > 0) report.covered /= report.area_m2;
    const auto ringJson = [&](const std::vector<Eigen::Vector2i>& ring) {
      auto out = json::array();
      // on a map (y north) clockwise rings become what GeoJSON wants when they are walked backwards
      for (std::size_t i = 0; i <= ring.size(); ++i) {
        const auto& p = ring[(ring.size() - i) % ring.size()];
        const auto g = lattice.geodeticFromPlane({box.west + p.x() * cell, box.north + p.y() * cell});
        out.push_back({geo::degrees(g.lon), geo::degrees(g.lat)});
      }
      return out;
    };
    if (plan)
      for (const auto& outline : outlines(gap, width, height)) {
        auto rings = json::array({ringJson(outline.outer)});
        for (const auto& hole : outline.holes) rings.push_back(ringJson(hole));
        gaps["features"].push_back({{"type", "Feature"},
                                    {"properties", {{"min_views", min_views}}},
                                    {"geometry", {{"type", "Polygon"}, {"coordinates", rings}}}});
      }
  }
  report.gaps_geojson = gaps.dump();
  return report;
}

std::string coverageJson(const CoverageReport& report) {
  nlohmann::json out{{"planned", report.planned},
                     {"area_m2", report.area_m2},
                     {"min_views", report.min_views},
                     {"area_by_views_m2", report.area_by_views_m2},
                     {"gaps", nlohmann::json::parse(report.gaps_geojson, nullptr, false)}};
  if (report.area_m2 > 0) out["covered_percent"] = 100 * report.covered;
  return out.dump();
}

Rgba coverageColours(const ViewGrid& grid) {
  constexpr std::uint8_t kColours[5][4] = {
      {0, 0, 0, 0}, {214, 69, 65, 150}, {235, 149, 50, 150}, {244, 208, 63, 150}, {63, 176, 105, 150}};
  Rgba out(grid.width, grid.height);
  for (int y = 0; y < grid.height; ++y)
    for (int x = 0; x < grid.width; ++x)
      std::copy_n(kColours[std::min<int>(4, grid.views[grid.index(x, y)])], 4, out.at(x, y));
  return out;
}

}  // namespace overfly::link
