#include "tiling/accuracy/truth_comparison.h"

#include <algorithm>
#include <cmath>
#include <future>
#include <vector>

namespace overfly::tiling {
namespace {

struct Errors {
  std::vector<double> heights[3];  // by scene::Hit::Kind
  std::size_t asked[3] = {};
  std::vector<double> luminance;

  void add(const Errors& other) {
    for (std::size_t kind = 0; kind < 3; ++kind) {
      heights[kind].insert(heights[kind].end(), other.heights[kind].begin(), other.heights[kind].end());
      asked[kind] += other.asked[kind];
    }
    luminance.insert(luminance.end(), other.luminance.begin(), other.luminance.end());
  }
};

int framesWith(const Eigen::Vector3d& point_in_ecef, const scene::FlightPlan& plan,
               const capture::CameraModel& camera, int enough) {
  int frames = 0;
  for (const scene::PlannedFrame& frame : plan.frames) {
    const Eigen::Vector3d in_camera =
        frame.exact.ecef_from_camera.conjugate() * (point_in_ecef - frame.exact.position_in_ecef);
    const auto pixel = camera.project(in_camera);
    if (!pixel || pixel->x() < 0 || pixel->y() < 0 || pixel->x() > camera.width || pixel->y() > camera.height)
      continue;
    if (++frames >= enough) break;
  }
  return frames;
}

double luminance(const std::uint8_t* rgb) { return 0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2]; }

ColourStatistics colourStatistics(std::vector<double> differences) {
  ColourStatistics s;
  s.texels = differences.size();
  if (differences.empty()) return s;
  std::sort(differences.begin(), differences.end());
  s.median = differences[differences.size() / 2];
  s.p95 = differences[differences.size() * 95 / 100];
  const auto far = std::upper_bound(differences.begin(), differences.end(), 32.0);
  s.beyond_32 = static_cast<double>(differences.end() - far) / static_cast<double>(differences.size());
  return s;
}

}  // namespace

TruthComparison compareWithTruth(const std::map<geo::TileKey, Tile>& tiles, const MapPlace& place,
                                 const scene::Truth& truth, const scene::FlightPlan& plan,
                                 const capture::CameraModel& camera, const TruthOptions& options) {
  TruthComparison result;
  if (tiles.empty()) return result;
  const int size = tiles.begin()->second.size;
  const bool with_shadows =
      scene::findEffect(truth.world().description.effects, scene::Effect::SunShadows) != nullptr;
  geo::TileKey first = tiles.begin()->first, last = first;
  for (const auto& [key, tile] : tiles) {
    first.x = std::min(first.x, key.x);
    first.y = std::min(first.y, key.y);
    last.x = std::max(last.x, key.x);
    last.y = std::max(last.y, key.y);
  }

  const auto compareRow = [&](std::int64_t y, Errors& errors) {
    for (std::int64_t x = first.x; x <= last.x; ++x) {
      const geo::TileKey key{place.zoom, x, y};
      const auto found = tiles.find(key);
      for (int v = options.stride / 2; v < size; v += options.stride)
        for (int u = options.stride / 2; u < size; u += options.stride) {
          const geo::Geodetic at = place.lattice.geodeticFromPlane(
              geo::TileLattice::planeOf(key, (u + 0.5) / size, (v + 0.5) / size));
          const auto point = truth.pointAt(at.lat, at.lon, place.texel_m, with_shadows);
          if (!point) continue;
          const Eigen::Vector3d in_ecef = geo::ecefFromGeodetic({at.lat, at.lon, point->height_m});
          const int frames = framesWith(in_ecef, plan, camera, options.min_frames);
          if (frames == 0) continue;
          const auto texel =
              static_cast<std::size_t>(v) * static_cast<std::size_t>(size) + static_cast<std::size_t>(u);
          if (found != tiles.end() && !found->second.color.empty()) {
            const std::uint8_t* rgba = &found->second.color[4 * texel];
            if (rgba[3] != 0)
              errors.luminance.push_back(std::abs(luminance(rgba) - luminance(point->colour.data())));
          }
          if (frames < options.min_frames) continue;
          const auto kind = static_cast<std::size_t>(point->kind);
          ++errors.asked[kind];
          if (found == tiles.end() || (found->second.kind[texel] & kMeasured) == 0) continue;
          errors.heights[kind].push_back(
              (static_cast<double>(found->second.elevation[texel]) - point->height_m) / place.gsd_m);
        }
    }
  };
  const auto half = [&](std::int64_t odd) {
    Errors errors;
    for (std::int64_t y = first.y + odd; y <= last.y; y += 2) compareRow(y, errors);
    return errors;
  };
  auto other = std::async(std::launch::async, half, 1);
  Errors errors = half(0);
  errors.add(other.get());

  std::vector<double> all;
  std::size_t asked = 0;
  for (std::size_t kind = 0; kind < 3; ++kind) {
    all.insert(all.end(), errors.heights[kind].begin(), errors.heights[kind].end());
    asked += errors.asked[kind];
  }
  result.all = statisticsOf(std::move(all), asked);
  result.ground = statisticsOf(std::move(errors.heights[0]), errors.asked[0]);
  result.solids = statisticsOf(std::move(errors.heights[1]), errors.asked[1]);
  result.plants = statisticsOf(std::move(errors.heights[2]), errors.asked[2]);
  result.colour = colourStatistics(std::move(errors.luminance));
  return result;
}

}  // namespace overfly::tiling
