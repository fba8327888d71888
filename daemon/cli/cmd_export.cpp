#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "daemon/cli/command.h"
#include "daemon/cli/progress.h"
#include "tiling/export/export.h"

namespace overfly::cli {
namespace {

struct Arguments {
  std::string map, out, layer = "color", datum, geoid;
  int epsg = 0, zoom = -1;
  bool utm = false, web_mercator = false, measured_only = false;
};

Result<int> exportTo(const Context& context, const Arguments& arguments) {
  const auto reader = tiling::MapReader::open(arguments.map);
  if (!reader) return tl::unexpected(reader.error());
  tiling::ExportOptions options;
  options.layer = *tiling::layerNamed(arguments.layer);
  if (arguments.zoom >= 0) options.zoom = arguments.zoom;
  if (arguments.epsg != 0) options.epsg = arguments.epsg;
  if (arguments.web_mercator) options.epsg = 3857;
  options.utm = arguments.utm;
  options.measured_only = arguments.measured_only;
  options.geoid_grid = arguments.geoid;
  if (arguments.datum == "ellipsoid") options.datum = capture::VerticalDatum::Ellipsoid;
  if (arguments.datum == "geoid") options.datum = capture::VerticalDatum::Geoid;
  Result<tiling::ExportReport> report = tiling::ExportReport{};
  {
    Progress progress("exporting " + arguments.layer, 1000);
    report = tiling::exportMap(*reader, arguments.out, options, [&](double share) {
      progress.update(static_cast<std::uint64_t>(share * 1000));
      return true;
    });
  }
  if (!report) return tl::unexpected(report.error());
  if (context.json) {
    fmt::print("{}\n", nlohmann::json({{"out", arguments.out},
                                       {"tiles", report->tiles},
                                       {"damaged_tiles", report->damaged_tiles},
                                       {"bytes", report->bytes},
                                       {"min_zoom", report->min_zoom},
                                       {"max_zoom", report->max_zoom}})
                           .dump());
  } else {
    fmt::print("{}: {} tiles, zoom {} to {}, {:.1f} MB\n", arguments.out, report->tiles, report->min_zoom,
               report->max_zoom, static_cast<double>(report->bytes) * 1e-6);
    if (report->damaged_tiles > 0)
      fmt::print("{} tiles are damaged on disk and were left out\n", report->damaged_tiles);
  }
  return kOk;
}

void build(CLI::App& command, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  command.add_option("MAP", arguments->map, "the map's .overfly file; it may be in use")->required();
  command.add_option("OUT", arguments->out, "a .tif, .mbtiles or .pmtiles file, or a folder for Z/X/Y tiles")
      ->required();
  command.add_option("--layer", arguments->layer, "color, elevation, quality, thermal or near_infrared")
      ->check(CLI::IsMember({"color", "elevation", "quality", "thermal", "near_infrared"}))
      ->capture_default_str();
  command
      .add_option("--zoom", arguments->zoom, "the finest zoom to export (default: the map's full resolution)")
      ->check(CLI::Range(0, 40));
  auto* epsg = command.add_option("--epsg", arguments->epsg, ".tif: the coordinate reference system");
  auto* utm =
      command.add_flag("--utm", arguments->utm, ".tif: the UTM zone of the map's middle")->excludes(epsg);
  command.add_flag("--webmercator", arguments->web_mercator, ".tif: EPSG:3857")
      ->excludes(epsg)
      ->excludes(utm);
  command
      .add_option("--datum", arguments->datum,
                  ".tif: heights above the ellipsoid or the geoid (default: as mapped)")
      ->check(CLI::IsMember({"ellipsoid", "geoid"}));
  command.add_option("--geoid", arguments->geoid, "geoid grid to convert heights by, .gtx (default: EGM96)");
  command.add_flag("--measured-only", arguments->measured_only,
                   "leave out what was interpolated or is provisional");
  context.onRun(command, [arguments, &context] { return exportTo(context, *arguments); });
}

const Registered kRegistered{"export", "writes a map as GeoTIFF, MBTiles, PMTiles or a folder of tiles",
                             build};

}  // namespace
}  // namespace overfly::cli
