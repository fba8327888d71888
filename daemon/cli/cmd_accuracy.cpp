#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "capture/import/import_flight.h"
#include "capture/import/survey.h"
#include "daemon/cli/command.h"
#include "daemon/cli/gpu.h"
#include "daemon/cli/progress.h"
#include "daemon/cli/scene_accuracy.h"
#include "render/scene/description.h"
#include "tiling/accuracy/accuracy.h"
#include "tiling/mapping/batch_map.h"
#include "tiling/mapping/mapper_settings.h"
#include "tiling/store/tile_codec.h"

namespace overfly::cli {
namespace {

struct Arguments {
  std::string flight, map;
  int track = 0, match_radius = 0, segment = 0;
  double step = 0, smooth = -1;
  bool one_surface = false, no_occlusion = false;
  SceneAccuracyOptions scene;
};

// A scene is named by its file, or by one word that is no folder.
bool isScene(const std::string& name) {
  return name.ends_with(".toml") || (name.find('/') == std::string::npos && !std::filesystem::exists(name) &&
                                     scene::loadScene(name).has_value());
}

Result<tiling::BatchOptions> batchOptions(const Arguments& arguments, const Context& context) {
  auto loaded = loadSettings(context);
  if (!loaded) return tl::unexpected(loaded.error());
  tiling::BatchOptions options;
  options.mapper = tiling::mapperOptions(loaded->settings);
  options.ground = tiling::groundOptions(loaded->settings);
  tiling::SweepOptions& sweep = options.mapper.sweep;
  if (arguments.step > 0) sweep.plane_step = arguments.step;
  if (arguments.smooth >= 0) sweep.smooth_planes = arguments.smooth;
  if (arguments.segment > 0) sweep.min_segment = arguments.segment;
  if (arguments.match_radius > 0) options.mapper.match.radius = arguments.match_radius;
  sweep.two_surfaces = !arguments.one_surface;
  sweep.occlusion = !arguments.no_occlusion;
  return options;
}

nlohmann::json asJson(const tiling::ErrorStatistics& s) {
  return {{"points", s.points},         {"measured", s.measured},
          {"complete", s.complete},     {"median_gsd", s.median},
          {"nmad_gsd", s.nmad},         {"rmse_gsd", s.rmse},
          {"p90_gsd", s.p90},           {"p99_gsd", s.p99},
          {"beyond_5_gsd", s.beyond_5}, {"beyond_10_gsd", s.beyond_10}};
}

void printHeader() {
  fmt::print("{:<24} {:>8} {:>9} {:>8} {:>7} {:>7} {:>6} {:>6} {:>8} {:>8}\n", "errors in GSD", "points",
             "complete", "median", "NMAD", "RMSE", "p90", "p99", "> 5", "> 10");
}

void printRow(const std::string& name, const tiling::ErrorStatistics& s) {
  fmt::print("{:<24} {:>8} {:>9.4f} {:>+8.3f} {:>7.3f} {:>7.3f} {:>6.2f} {:>6.2f} {:>8.4f} {:>8.4f}\n", name,
             s.points, s.complete, s.median, s.nmad, s.rmse, s.p90, s.p99, s.beyond_5, s.beyond_10);
}

Result<int> compareMap(const Arguments& arguments, const capture::Flight& flight,
                       std::span<const tiling::ReferencePoint> points, const Context& context);

Result<int> run(const Arguments& arguments, const Context& context) {
  if (isScene(arguments.flight)) {
    SceneAccuracyOptions options = arguments.scene;
    options.scene = arguments.flight;
    options.json = context.json;
    const auto mapping = batchOptions(arguments, context);
    if (!mapping) return tl::unexpected(mapping.error());
    return sceneAccuracy(options, *mapping, context);
  }
  auto flight = capture::importFlight(arguments.flight);
  if (!flight) return tl::unexpected(flight.error());
  if (!flight->info().origin)
    return fail(ErrorCode::BadInput,
                "the flight has no local origin, so its reference_points.csv cannot be placed");
  auto points = tiling::readReferencePoints(std::filesystem::path(arguments.flight) / "reference_points.csv",
                                            *flight->info().origin);
  if (!points) return tl::unexpected(points.error());
  if (!arguments.map.empty()) return compareMap(arguments, *flight, *points, context);
  auto gl_context = openGpu(context);
  if (!gl_context) return tl::unexpected(gl_context.error());

  const auto options = batchOptions(arguments, context);
  if (!options) return tl::unexpected(options.error());
  StageProgress progress("mapping ");
  auto mapped = tiling::mapFlightToTiles(*gl_context, *flight, *options, std::ref(progress));
  progress.finish();
  if (!mapped) return tl::unexpected(mapped.error());
  const auto& [result, tiles] = *mapped;
  const tiling::MapGround& ground = result.ground;
  const tiling::Comparison comparison = tiling::compare(
      tiles, ground.lattice, ground.base_zoom, ground.anchor_px, *points, ground.gsd_m, arguments.track);
  const tiling::MapperStatistics& s = result.statistics;
  const double per_tile = result.wall_s / static_cast<double>(std::max<std::size_t>(tiles.size(), 1));
  const double per_frame =
      result.wall_s / static_cast<double>(std::max<std::uint64_t>(result.frames_used, 1));
  if (context.json) {
    fmt::print("{}\n", nlohmann::json{{"flight", arguments.flight},
                                      {"gsd_m", ground.gsd_m},
                                      {"ground_height_m", ground.height_m},
                                      {"base_zoom", ground.base_zoom},
                                      {"texel_m", ground.texel_m},
                                      {"cell_zoom", result.cell_zoom},
                                      {"frames", result.frames_used},
                                      {"tiles", tiles.size()},
                                      {"strong_track", comparison.strong_track},
                                      {"strong", asJson(comparison.strong)},
                                      {"all", asJson(comparison.all)},
                                      {"wall_s", result.wall_s},
                                      {"s_per_tile", per_tile},
                                      {"s_per_frame", per_frame},
                                      {"samples", s.samples},
                                      {"stages_s",
                                       {{"rectify", s.rectify_s},
                                        {"match_images", s.match_s},
                                        {"sweep", s.sweep_s},
                                        {"blend", s.blend_s},
                                        {"orthophoto", s.ortho_s}}}}
                           .dump(2));
    return kOk;
  }
  fmt::print(
      "{}: GSD {:.2f} cm, ground at {:.1f} m, tiles at zoom {} ({:.2f} cm a texel), swept at zoom {}\n\n",
      arguments.flight, 100 * ground.gsd_m, ground.height_m, ground.base_zoom, 100 * ground.texel_m,
      result.cell_zoom);
  printHeader();
  printRow(fmt::format("strong (track >= {})", comparison.strong_track), comparison.strong);
  printRow("all", comparison.all);
  fmt::print("\n{} tiles from {} frames in {:.1f} s: {:.3f} s per tile, {:.3f} s per frame\n", tiles.size(),
             result.frames_used, result.wall_s, per_tile, per_frame);
  fmt::print(
      "rectify {:.1f} s, match images {:.1f} s, sweep {:.1f} s ({:.0f} M samples, {} cells), blend {:.1f} s, "
      "orthophoto {:.1f} s\n",
      s.rectify_s, s.match_s, s.sweep_s, static_cast<double>(s.samples) / 1e6, s.cells_swept, s.blend_s,
      s.ortho_s);
  for (const std::string& refused : result.refused) fmt::print("not used: {}\n", refused);
  return kOk;
}

// A finished map's level-0 tiles and where they lie, instead of mapping the flight here.
struct FinishedMap {
  std::map<geo::TileKey, tiling::Tile> tiles;
  geo::TileLattice lattice = geo::TileLattice::webMercator();
  int zoom = 0;
  double ground_height_m = 0, anchor_px = 0.5;
};

Result<FinishedMap> readMap(const std::string& file) {
  auto reader = tiling::MapReader::open(file);
  if (!reader) return tl::unexpected(reader.error());
  auto meta = reader->meta();
  if (!meta) return tl::unexpected(meta.error());
  FinishedMap map;
  auto lattice = geo::TileLattice::parse(meta->lattice);
  if (!lattice) return tl::unexpected(lattice.error());
  map.lattice = *lattice;
  map.zoom = meta->base_zoom;
  const nlohmann::json extra = nlohmann::json::parse(meta->extra, nullptr, false);
  if (extra.is_discarded() || !extra.contains("ground"))
    return fail(ErrorCode::BadInput, file + " does not say where its ground is");
  map.ground_height_m = extra["ground"].value("height_m", 0.0);
  map.anchor_px = extra["ground"].value("anchor_px", 0.5);
  auto keys = reader->keys(map.zoom, tiling::Layer::Elevation, {}, SIZE_MAX);
  if (!keys) return tl::unexpected(keys.error());
  for (const geo::TileKey& key : *keys) {
    auto tile = tiling::readTile(*reader, key, only(tiling::Layer::Elevation) | only(tiling::Layer::Quality));
    if (!tile) return tl::unexpected(tile.error());
    map.tiles.emplace(key, std::move(*tile));
  }
  return map;
}

Result<int> compareMap(const Arguments& arguments, const capture::Flight& flight,
                       std::span<const tiling::ReferencePoint> points, const Context& context) {
  auto map = readMap(arguments.map);
  if (!map) return tl::unexpected(map.error());
  // Of the flight: a map that was made in flight knows the GSD of its first frames alone.
  auto survey = capture::surveyFlight(flight, map->ground_height_m);
  if (!survey) return tl::unexpected(survey.error());
  const tiling::Comparison comparison = tiling::compare(map->tiles, map->lattice, map->zoom, map->anchor_px,
                                                        points, survey->gsd_m, arguments.track);
  if (context.json) {
    fmt::print("{}\n", nlohmann::json{{"map", arguments.map},
                                      {"gsd_m", survey->gsd_m},
                                      {"tiles", map->tiles.size()},
                                      {"strong_track", comparison.strong_track},
                                      {"strong", asJson(comparison.strong)},
                                      {"all", asJson(comparison.all)}}
                           .dump(2));
    return kOk;
  }
  fmt::print("{}: {} tiles at zoom {}; GSD of the flight {:.2f} cm\n\n", arguments.map, map->tiles.size(),
             map->zoom, 100 * survey->gsd_m);
  printHeader();
  printRow(fmt::format("strong (track >= {})", comparison.strong_track), comparison.strong);
  printRow("all", comparison.all);
  return kOk;
}

void build(CLI::App& command, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  command
      .add_option("FLIGHT", arguments->flight,
                  "folder of a flight with reference_points.csv; or a scene, which is rendered, mapped and "
                  "compared with its truth")
      ->required();
  command.add_option("--map", arguments->map, "a finished map to compare instead of mapping the flight here");
  command.add_option("--step", arguments->step, "distance of planes, texels of parallax");
  command.add_option("--smooth", arguments->smooth, "edge-preserving smoothing, planes");
  command.add_option("--segment", arguments->segment, "smallest island kept, texels");
  command.add_option("--match-radius", arguments->match_radius, "radius of the local normalisation, pixels");
  command.add_option("--track", arguments->track, "frames that must see a strong point; 0: the mean");
  command.add_flag("--one-surface", arguments->one_surface, "no second search at steps");
  command.add_flag("--no-occlusion", arguments->no_occlusion, "hidden views count at steps too");
  SceneAccuracyOptions& scene = arguments->scene;
  command.add_option("--effects", scene.effects,
                     "scene: these effects instead of its own: NAME,NAME or none");
  command.add_flag("--each-effect", scene.each_effect,
                   "scene: also without each of its effects, and without any");
  command.add_option("--reduce", scene.reduce, "scene: pictures of so many times fewer columns and rows")
      ->check(CLI::Range(1, 8));
  command.add_flag("--table", scene.table, "scene: one row of a Markdown table per set of effects");
  command.add_option("--frames", scene.frames, "scene: only the first so many frames")
      ->check(CLI::PositiveNumber);
  context.onRun(command, [arguments, &context]() -> Result<int> { return run(*arguments, context); });
}

const Registered registered{"accuracy", "maps a flight and compares its heights with reference points",
                            build};

}  // namespace
}  // namespace overfly::cli
