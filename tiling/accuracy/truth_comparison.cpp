#include "tiling/accuracy/truth_comparison.h"

#include <algorithm>
#include <cmath>
#include <future>
#include <vector>

namespace overfly::tiling {
namespace {

constexpr int kViewsForHeight = 2;  // fewer see a place: its height is not to be had from pictures

// Height errors of one sort of places, and how many were asked for.
struct Sort {
  std::vector<double> heights;
  std::size_t asked = 0;

  void add(const Sort& other) {
    heights.insert(heights.end(), other.heights.begin(), other.heights.end());
    asked += other.asked;
  }
};

struct Errors {
  Sort by_kind[3];  // scene::Hit::Kind
  Sort seen, hidden;
  std::vector<double> luminance;

  void add(const Errors& other) {
    for (std::size_t kind = 0; kind < 3; ++kind) by_kind[kind].add(other.by_kind[kind]);
    seen.add(other.seen);
    hidden.add(other.hidden);
    luminance.insert(luminance.end(), other.luminance.begin(), other.luminance.end());
  }
};

// How many frames have the point within their picture, up to `enough`; with a geometry only those that
// nothing hides it from.
int framesWith(const Eigen::Vector3d& point_in_ecef, const scene::FlightPlan& plan,
               const capture::CameraModel& camera, int enough, const scene::Geometry* geometry = nullptr) {
  constexpr double kOff = 0.02;  // metres: nearer to the point the ray meets the point's own surface
  const auto hidden = [&](const Eigen::Vector3d& eye_in_ecef) {
    const geo::LocalFrame& local = geometry->world().local;
    const Eigen::Vector3d point = local.enuFromEcef(point_in_ecef),
                          way = local.enuFromEcef(eye_in_ecef) - point;
    return geometry->blocked({point, way / way.norm()}, kOff, way.norm());
  };
  int frames = 0;
  for (const scene::PlannedFrame& frame : plan.frames) {
    const Eigen::Vector3d in_camera =
        frame.exact.ecef_from_camera.conjugate() * (point_in_ecef - frame.exact.position_in_ecef);
    const auto pixel = camera.project(in_camera);
    if (!pixel || pixel->x() < 0 || pixel->y() < 0 || pixel->x() > camera.width || pixel->y() > camera.height)
      continue;
    if (geometry != nullptr && hidden(frame.exact.position_in_ecef)) continue;
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
          Sort& of_kind = errors.by_kind[static_cast<std::size_t>(point->kind)];
          const bool seen =
              framesWith(in_ecef, plan, camera, kViewsForHeight, &truth.geometry()) >= kViewsForHeight;
          Sort& of_sight = seen ? errors.seen : errors.hidden;
          ++of_kind.asked;
          ++of_sight.asked;
          if (found == tiles.end() || (found->second.kind[texel] & kMeasured) == 0) continue;
          const double error =
              (static_cast<double>(found->second.elevation[texel]) - point->height_m) / place.gsd_m;
          of_kind.heights.push_back(error);
          of_sight.heights.push_back(error);
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

  Sort all;
  for (const Sort& kind : errors.by_kind) all.add(kind);
  const auto statistics = [](Sort& sort) { return statisticsOf(std::move(sort.heights), sort.asked); };
  result.all = statistics(all);
  result.ground = statistics(errors.by_kind[0]);
  result.solids = statistics(errors.by_kind[1]);
  result.plants = statistics(errors.by_kind[2]);
  result.seen = statistics(errors.seen);
  result.hidden = statistics(errors.hidden);
  result.colour = colourStatistics(std::move(errors.luminance));
  return result;
}

}  // namespace overfly::tiling
