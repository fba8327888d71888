#include <cmath>
#include <cstdio>
#include <filesystem>

#include "capture/import/import_flight.h"
#include "tests/bench/sweep/bench.h"
#include "tests/bench/sweep/site.h"
#include "tiling/accuracy/accuracy.h"
#include "tiling/accuracy/border_steps.h"
#include "tiling/mapping/batch_map.h"
#include "tiling/mapping/mapper_settings.h"

namespace overfly::bench {

using namespace overfly::tiling;

bool borders(gl::Context& context, const std::string& folder) {
  const capture::Flight flight = need(capture::importFlight(folder));
  BatchOptions options;
  options.mapper = mapperOptions({});
  const auto [result, tiles] = need(mapFlightToTiles(context, flight, options));
  const std::vector<ReferencePoint> points = need(readReferencePoints(
      std::filesystem::path(folder) / "reference_points.csv", flight.info().origin.value()));
  const MapGround& ground = result.ground;
  const ErrorStatistics strong =
      compare(tiles, ground.lattice, ground.base_zoom, ground.anchor_px, points, ground.gsd_m).strong;
  std::printf("%s: complete %.4f, median %+.3f, NMAD %.3f GSD, beyond 10 GSD %.4f; %.1f s, sweeping %.1f s\n",
              folder.c_str(), strong.complete, strong.median, strong.nmad, strong.beyond_10, result.wall_s,
              result.statistics.sweep_s);
  const int tiles_a_cell = 1 << (result.ground.base_zoom - result.cell_zoom);
  const BorderSteps all = borderSteps(tiles), cells = borderSteps(tiles, tiles_a_cell);
  std::printf("%s: median height step inside tiles %.2f mm (%zu pairs of texels)\n", folder.c_str(),
              1000 * all.inside_m, all.insides);
  std::printf("  across the borders of tiles %.2f mm (%zu): %.3f times\n", 1000 * all.across_borders_m,
              all.borders, all.ratio());
  std::printf("  across the borders of swept cells %.2f mm (%zu): %.3f times\n",
              1000 * cells.across_borders_m, cells.borders, cells.ratio());
  return cells.ratio() <= 1.05 && all.ratio() <= 1.05;
}

}  // namespace overfly::bench
