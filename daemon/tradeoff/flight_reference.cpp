#include "daemon/tradeoff/flight_reference.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>
#include <random>

#include "capture/geo/footprint.h"
#include "capture/import/import_flight.h"
#include "render/scene/record_scene.h"
#include "render/scene/truth.h"

namespace overfly::tradeoff {
namespace {

bool inside(const std::array<geo::Geodetic, 4>& corners, double lat, double lon) {
  int left = 0, right = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const geo::Geodetic &a = corners[i], &b = corners[(i + 1) % 4];
    const double cross = (b.lon - a.lon) * (lat - a.lat) - (b.lat - a.lat) * (lon - a.lon);
    (cross > 0 ? left : right) += 1;
  }
  return left == 0 || right == 0;
}

}  // namespace

Result<FlightReference> recordedReference(const std::filesystem::path& folder) {
  auto flight = capture::importFlight(folder);
  if (!flight) return tl::unexpected(flight.error());
  if (!flight->info().origin)
    return fail(ErrorCode::BadInput,
                folder.string() + " has no local origin, so its reference_points.csv cannot be placed");
  auto points = tiling::readReferencePoints(folder / "reference_points.csv", *flight->info().origin);
  if (!points) return tl::unexpected(points.error());
  std::string name = folder.filename().string();
  if (name.empty()) name = folder.parent_path().filename().string();
  return FlightReference{name, std::move(*flight), std::move(*points), 0,
                         "sparse bundle-adjusted points of the flight"};
}

Result<FlightReference> simulatedReference(const std::string& scene_file_or_name,
                                           const std::filesystem::path& folder, int frames,
                                           std::size_t points, std::uint64_t seed) {
  auto description = scene::loadScene(scene_file_or_name);
  if (!description) return tl::unexpected(description.error());
  if (frames > 0) description->path.frames = std::min(description->path.frames, frames);
  auto world = scene::buildWorld(*description);
  if (!world) return tl::unexpected(world.error());
  if (auto recorded = scene::recordScene(*world, folder); !recorded) return tl::unexpected(recorded.error());
  auto flight = capture::importFlight(folder);
  if (!flight) return tl::unexpected(flight.error());

  std::vector<geo::Footprint> footprints;
  double south = 2, north = -2, west = 4, east = -4;
  for (const capture::FlightFrame& frame : flight->frames()) {
    if (!frame.frame.pose) continue;
    auto seen = geo::footprint(frame.frame.camera, *frame.frame.pose, *flight->info().ground_height_m);
    if (!seen) continue;
    for (const geo::Geodetic& corner : seen->corners) {
      south = std::min(south, corner.lat), north = std::max(north, corner.lat);
      west = std::min(west, corner.lon), east = std::max(east, corner.lon);
    }
    footprints.push_back(std::move(*seen));
  }
  const scene::Truth truth(*world);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> lat(south, north), lon(west, east);
  FlightReference result{
      (*world)->description.name, std::move(*flight), {}, 3, "heights of the scene itself"};
  constexpr std::size_t kTriesPerPoint = 50;
  for (std::size_t tries = 0; tries < kTriesPerPoint * points && result.points.size() < points; ++tries) {
    const double at_lat = lat(random), at_lon = lon(random);
    const auto views = std::count_if(footprints.begin(), footprints.end(), [&](const geo::Footprint& f) {
      return inside(f.corners, at_lat, at_lon);
    });
    if (views < result.strong_track) continue;
    if (const std::optional<double> height = truth.heightAt(at_lat, at_lon))
      result.points.push_back({{at_lat, at_lon, *height}, static_cast<int>(views)});
  }
  if (result.points.empty())
    return fail(ErrorCode::BadInput,
                fmt::format("no ground of the scene {} is seen by three frames", result.name));
  return result;
}

}  // namespace overfly::tradeoff
