#include <fmt/format.h>
#include <malloc.h>
#include <sys/resource.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "capture/geo/footprint.h"
#include "capture/import/import_flight.h"
#include "daemon/cli/planar_command.h"
#include "daemon/cli/progress.h"
#include "tiling/planar/planar_map.h"
#include "tiling/store/make_frame_record.h"

namespace overfly::cli {
namespace {

struct Ground {
  double height_m = 0, gsd_m = 0, anchor_px = 0.5;
  int zoom = 0;
};

// The plane and the zoom: what the user says, else what the flight says and its first usable frame's GSD.
Result<Ground> groundOf(const PlanarCommand& command, const capture::Flight& flight) {
  Ground ground;
  if (command.ground_m)
    ground.height_m = *command.ground_m;
  else if (flight.info().ground_height_m)
    ground.height_m = *flight.info().ground_height_m;
  else
    return fail(ErrorCode::BadInput, "the flight does not say how high its ground is: give it with --ground");
  for (const capture::FlightFrame& frame : flight.frames()) {
    if (!frame.frame.pose) continue;
    const auto footprint = geo::footprint(frame.frame.camera, *frame.frame.pose, ground.height_m);
    if (!footprint) continue;
    ground.gsd_m = footprint->gsd_m;
    const geo::Geodetic& place = footprint->centre;
    const auto plane = command.lattice.planeFromGeodetic(place.lat, place.lon);
    if (!plane)
      return fail(
          ErrorCode::BadSettings,
          fmt::format("the lattice {} does not reach the flight: take another", command.lattice.text()));
    ground.anchor_px = plane->x();
    ground.zoom = command.lattice.zoomForGsd(command.gsd_m.value_or(ground.gsd_m), place.lat, place.lon,
                                             command.tile_size);
    return ground;
  }
  return fail(ErrorCode::BadInput,
              fmt::format("no frame looks down on ground at {:.1f} m: check --ground", ground.height_m));
}

// One heap for all threads: what one frees, another takes. With a heap for each, every one keeps room for the
// largest tile that it ever coded (tests/stress/planar).
void keepHeapSmall() {
#ifdef __GLIBC__
  mallopt(M_ARENA_MAX, 1);
#endif
}

}  // namespace

Result<int> mapOntoPlane(const PlanarCommand& command) {
  keepHeapSmall();
  auto flight = capture::importFlight(command.flight);
  if (!flight) return tl::unexpected(flight.error());
  const auto ground = groundOf(command, *flight);
  if (!ground) return tl::unexpected(ground.error());
  tiling::MapMeta meta;
  meta.name = std::filesystem::path(command.map).stem().string();
  meta.lattice = command.lattice.text();
  meta.datum = flight->info().datum;
  meta.geoid = flight->info().geoid_model;
  meta.base_zoom = ground->zoom;
  meta.tile_size = command.tile_size;
  meta.created_utc_ns = flight->at(0).frame.time_ns + flight->at(0).frame.utc_offset_ns;
  meta.extra =
      nlohmann::json{
          {"ground",
           {{"gsd_m", ground->gsd_m}, {"height_m", ground->height_m}, {"anchor_px", ground->anchor_px}}}}
          .dump();
  // Tiles that are still needed are in the map's own memory: little for SQLite's.
  auto store = tiling::MapStore::create(command.map, meta, {.vfs = {}, .cache_bytes = 1u << 20});
  if (!store) return tl::unexpected(store.error());
  tiling::PlanarOptions options;
  options.height_m = ground->height_m;
  options.anchor_px = ground->anchor_px;
  // Tiles that are still in memory are drawn on without the frames that they already show.
  const std::size_t cache_bytes = static_cast<std::size_t>(command.cache_mb) << 20;
  options.image_bytes = cache_bytes / 4;
  options.tile_bytes = cache_bytes - options.image_bytes;
  auto map = tiling::PlanarMap::create(std::move(*store), options);
  if (!map) return tl::unexpected(map.error());

  const auto start = std::chrono::steady_clock::now();
  std::vector<std::string> refused;
  Progress progress("mapping frames onto a plane", flight->size());
  for (std::size_t i = 0; i < flight->size(); ++i) {
    progress.update(i);
    auto frame = flight->load(i);
    if (!frame) {
      refused.push_back(frame.error().message);
      continue;
    }
    auto added = (*map)->addFrame(i, *frame, [&flight, i] { return flight->load(i); });
    if (added) continue;
    if (added.error().code == ErrorCode::Io) return tl::unexpected(added.error());
    refused.push_back(added.error().message);
  }
  if (auto done = (*map)->finish(); !done) return tl::unexpected(done.error());
  progress.update(flight->size());
  progress.finish();
  const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const tiling::PlanarStatistics& s = (*map)->statistics();
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  if (command.json) {
    fmt::print("{}\n", nlohmann::json{{"map", command.map},
                                      {"frames", s.frames},
                                      {"refused", refused},
                                      {"tile_updates", s.tiles},
                                      {"parents", s.parents},
                                      {"base_zoom", ground->zoom},
                                      {"wall_s", wall_s},
                                      {"cpu_s",
                                       {{"decode", s.decode_s},
                                        {"plan", s.plan_s},
                                        {"project", s.project_s},
                                        {"encode", s.encode_s},
                                        {"parents", s.parents_s}}},
                                      {"commit_wait_s", s.commit_s},
                                      {"layer_bytes", s.bytes},
                                      {"peak_rss_kb", usage.ru_maxrss}}
                           .dump(2));
    return 0;
  }
  fmt::print(
      "{}: {} tile updates at zoom {} and {} above them, from {} frames in {:.1f} s ({:.0f} a second)\n",
      command.map, s.tiles, ground->zoom, s.parents, s.frames, wall_s,
      static_cast<double>(s.tiles) / std::max(wall_s, 1e-9));
  for (const std::string& reason : refused) fmt::print("not used: {}\n", reason);
  return 0;
}

}  // namespace overfly::cli
