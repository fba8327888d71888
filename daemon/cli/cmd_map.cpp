#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "capture/import/import_flight.h"
#include "daemon/cli/command.h"
#include "daemon/cli/gpu.h"
#include "daemon/cli/planar_command.h"
#include "daemon/cli/progress.h"
#include "tiling/mapping/batch_map.h"
#include "tiling/mapping/drape.h"
#include "tiling/mapping/mapper_settings.h"
#include "tiling/pyramid/map_writer.h"
#include "tiling/pyramid/pyramid.h"
#include "tiling/store/make_frame_record.h"
#include "tiling/store/tile_codec.h"

namespace overfly::cli {
namespace {

struct Arguments {
  std::string flight, map, onto, layer, lattice = "webmercator";
  double gsd_m = 0, ground_m = 0;
  bool ground_given = false, planar = false;
  int tile_size = 0, cache_mb = 256, reduce = 1;  // tile_size 0: the setting's
};

tiling::FrameRecord recordOf(std::uint64_t id, const capture::FlightFrame& source,
                             const tiling::IndexedFrame& indexed) {
  tiling::FrameRecord record = tiling::makeFrameRecord(id, source.frame);
  record.path = std::filesystem::absolute(source.file).string();
  record.bytes = source.bytes.value_or(0);
  record.state = tiling::FrameState::Mapped;
  if (auto footprint = geo::footprint(indexed.camera, indexed.pose, indexed.ground_height_m))
    record.footprint = *footprint;
  return record;
}

// The frames of a second camera, over the surface of a map that is there.
Result<int> mapOnto(const Arguments& arguments, const Context& context) {
  const auto start = std::chrono::steady_clock::now();
  const tiling::Layer layer = *tiling::layerNamed(arguments.layer);
  auto flight = capture::importFlight(arguments.flight);
  if (!flight) return tl::unexpected(flight.error());
  auto store = tiling::MapStore::open(arguments.onto);
  if (!store) return tl::unexpected(store.error());
  const tiling::MapMeta& meta = store->meta();
  if (meta.datum != flight->info().datum)
    return fail(ErrorCode::BadInput,
                arguments.onto + " and " + arguments.flight +
                    " count heights from different surfaces: give the flight that was taken together with "
                    "the map's");
  auto lattice = geo::TileLattice::parse(meta.lattice);
  if (!lattice) return tl::unexpected(lattice.error());
  auto reader = store->reader();
  if (!reader) return tl::unexpected(reader.error());
  auto loaded = loadSettings(context);
  if (!loaded) return tl::unexpected(loaded.error());
  auto gl_context = openGpu(context);
  if (!gl_context) return tl::unexpected(gl_context.error());

  tiling::DrapeSurface surface;
  surface.lattice = *lattice;
  surface.base_zoom = meta.base_zoom;
  const auto extra = nlohmann::json::parse(meta.extra, nullptr, false);
  const nlohmann::json::json_pointer anchor("/ground/anchor_px");
  if (!extra.is_discarded() && extra.contains(anchor) && extra[anchor].is_number())
    surface.anchor_px = extra[anchor];
  surface.heights = [&](const geo::TileKey& key) -> Result<std::vector<float>> {
    auto tile = tiling::readTile(*reader, key, tiling::only(tiling::Layer::Elevation));
    if (tile) return std::move(tile->elevation);
    if (tile.error().code == ErrorCode::NotFound) return std::vector<float>();
    return tl::unexpected(tile.error());
  };
  tiling::MapperOptions options = tiling::mapperOptions(loaded->settings);
  options.tile_size = meta.tile_size;
  tiling::MapWriter writer(*store);
  std::size_t tiles = 0;
  StageProgress progress("mapping ");
  auto result = tiling::drapeFlight(
      *gl_context, *flight, surface, options,
      [&](tiling::Tile&& tile) {
        ++tiles;
        return writer.addPicture(tile, layer);
      },
      std::ref(progress));
  progress.finish();
  if (!result) return tl::unexpected(result.error());
  if (auto ok = writer.flush(); !ok) return tl::unexpected(ok.error());
  auto parents = tiling::makePyramid(*store, layer);
  if (!parents) return tl::unexpected(parents.error());
  const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (context.json) {
    fmt::print("{}\n", nlohmann::json{{"map", arguments.onto},
                                      {"layer", arguments.layer},
                                      {"frames", result->frames_used},
                                      {"refused", result->refused},
                                      {"tiles", tiles},
                                      {"parents", *parents},
                                      {"wall_s", wall_s}}
                           .dump(2));
    return kOk;
  }
  fmt::print("{}: {} tiles of the layer {} at zoom {} and {} above them, from {} frames in {:.1f} s\n",
             arguments.onto, tiles, arguments.layer, meta.base_zoom, *parents, result->frames_used, wall_s);
  for (const std::string& refused : result->refused) fmt::print("not used: {}\n", refused);
  return kOk;
}

Result<int> run(const Arguments& arguments, const Context& context) {
  if (!arguments.onto.empty()) return mapOnto(arguments, context);
  if (arguments.map.empty())
    return fail(ErrorCode::BadSettings,
                "name the map to make with -o, or the one to add a layer to with --onto");
  auto lattice = geo::TileLattice::parse(arguments.lattice);
  if (!lattice) return fail(ErrorCode::BadSettings, "--lattice: " + lattice.error().message);
  if (std::filesystem::exists(arguments.map))
    return fail(ErrorCode::BadInput, arguments.map + " exists already: name a new file, or remove it first");
  if (arguments.planar) {
    PlanarCommand planar;
    planar.flight = arguments.flight;
    planar.map = arguments.map;
    planar.lattice = *lattice;
    if (arguments.tile_size > 0) planar.tile_size = arguments.tile_size;
    planar.cache_mb = arguments.cache_mb;
    planar.json = context.json;
    if (arguments.ground_given) planar.ground_m = arguments.ground_m;
    if (arguments.gsd_m > 0) planar.gsd_m = arguments.gsd_m;
    return mapOntoPlane(planar);
  }
  auto flight = capture::importFlight(arguments.flight);
  if (!flight) return tl::unexpected(flight.error());
  auto gl_context = openGpu(context);
  if (!gl_context) return tl::unexpected(gl_context.error());

  auto loaded = loadSettings(context);
  if (!loaded) return tl::unexpected(loaded.error());
  tiling::BatchOptions options;
  options.mapper = tiling::mapperOptions(loaded->settings);
  options.ground = tiling::groundOptions(loaded->settings);
  options.lattice = *lattice;
  options.reduce = arguments.reduce;
  if (arguments.tile_size > 0) options.mapper.tile_size = arguments.tile_size;
  if (arguments.gsd_m > 0) options.ground.gsd_m = arguments.gsd_m;
  if (arguments.ground_given) options.ground.height_m = arguments.ground_m;
  std::optional<tiling::MapStore> store;
  std::optional<tiling::MapWriter> writer;
  std::size_t tiles = 0;
  StageProgress progress("mapping ");
  tiling::BatchEvents events;
  events.progress = std::ref(progress);
  events.ground = [&](const tiling::MapGround& ground) -> Result<void> {
    tiling::MapMeta meta;
    meta.name = std::filesystem::path(arguments.map).stem().string();
    meta.lattice = ground.lattice.text();
    meta.datum = flight->info().datum;
    meta.geoid = flight->info().geoid_model;
    meta.base_zoom = ground.base_zoom;
    meta.tile_size = options.mapper.tile_size;
    const capture::Frame& first = flight->at(0).frame;
    meta.created_utc_ns = first.time_ns + first.utc_offset_ns;
    meta.extra =
        nlohmann::json{
            {"ground",
             {{"gsd_m", ground.gsd_m}, {"height_m", ground.height_m}, {"anchor_px", ground.anchor_px}}}}
            .dump();
    auto created = tiling::MapStore::create(arguments.map, meta);
    if (!created) return tl::unexpected(created.error());
    store.emplace(std::move(*created));
    writer.emplace(*store);
    return {};
  };
  events.frame = [&](std::uint64_t id, const capture::FlightFrame& frame,
                     const tiling::IndexedFrame& indexed) -> Result<void> {
    writer->add(recordOf(id, frame, indexed));
    return {};
  };
  events.tile = [&](tiling::Tile&& tile) -> Result<void> {
    ++tiles;
    return writer->add(tile);
  };
  auto result = tiling::mapFlight(*gl_context, *flight, options, events);
  progress.finish();
  if (!result) return tl::unexpected(result.error());
  if (auto ok = writer->flush(); !ok) return tl::unexpected(ok.error());
  auto parents = tiling::makePyramid(*store);
  if (!parents) return tl::unexpected(parents.error());
  if (context.json) {
    fmt::print("{}\n", nlohmann::json{{"map", arguments.map},
                                      {"frames", result->frames_used},
                                      {"refused", result->refused},
                                      {"tiles", tiles},
                                      {"parents", *parents},
                                      {"base_zoom", result->ground.base_zoom},
                                      {"gsd_m", result->ground.gsd_m},
                                      {"wall_s", result->wall_s}}
                           .dump(2));
    return kOk;
  }
  fmt::print("{}: {} tiles at zoom {} and {} above them, from {} frames in {:.1f} s\n", arguments.map, tiles,
             result->ground.base_zoom, *parents, result->frames_used, result->wall_s);
  for (const std::string& refused : result->refused) fmt::print("not used: {}\n", refused);
  return kOk;
}

void build(CLI::App& command, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  command.add_option("FLIGHT", arguments->flight, "folder of a flight")->required();
  CLI::Option* output = command.add_option("-o,--output", arguments->map, "map file to make");
  CLI::Option* onto = command.add_option(
      "--onto", arguments->onto, "a map to lay the flight's pictures over, as a layer of a second camera");
  CLI::Option* layer =
      command.add_option("--layer", arguments->layer, "with --onto: thermal or near_infrared");
  layer->check(CLI::IsMember({"thermal", "near_infrared"}))->needs(onto);
  onto->excludes(output)->needs(layer);
  command.add_option("--lattice", arguments->lattice, "webmercator, utm:33N, ups:N, local:LAT,LON")
      ->excludes(onto);
  command.add_option("--gsd", arguments->gsd_m, "ground sampling distance of the finest level, metres");
  CLI::Option* ground =
      command.add_option("--ground", arguments->ground_m,
                         "height of the ground in the flight's datum, where the images do not tell");
  CLI::Option* planar =
      command.add_flag("--planar", arguments->planar,
                       "lay the frames onto level ground instead of finding heights: quick, needs no GPU");
  command.add_option("--tile-size", arguments->tile_size, "texels along a tile's side: 256 or 512")
      ->check(CLI::IsMember({256, 512}));
  CLI::Option* reduce =
      command.add_option("--reduce", arguments->reduce,
                         "frames of 2, 4 or 8 times fewer columns and rows: a quick, coarser map");
  reduce->check(CLI::IsMember({1, 2, 4, 8}));
  planar->excludes(reduce);
  command
      .add_option("--cache-mb", arguments->cache_mb, "with --planar: decoded frames and tiles kept in memory")
      ->check(CLI::Range(8, 65536));
  context.onRun(command, [arguments, ground, &context]() -> Result<int> {
    arguments->ground_given = ground->count() > 0;
    return run(*arguments, context);
  });
}

const Registered registered{"map", "maps a recorded flight, as fast as it can", build};

}  // namespace
}  // namespace overfly::cli
