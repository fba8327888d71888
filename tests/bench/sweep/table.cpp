#include <cmath>
#include <cstdio>
#include <string>
#include <tuple>

#include "tests/bench/sweep/bench.h"
#include "tests/bench/sweep/site.h"

namespace overfly::bench {

using namespace overfly::tiling;

namespace {

constexpr std::size_t kImages[] = {2, 4, 6, 8};

struct Measured {
  double cpu_s = 0, nmad = 0, complete = 0;
};

// Mip levels as windows (5.11) for Sad and Ssd, on luminance; true windows for Zncc and Census.
Measured measure(const Site& site, Sweeper& sweeper, const Site::Cell& cell, const SweepGrid& grid,
                 const Site::Views& views, MatchCost cost, int window, bool half, double step_m) {
  const auto once = [&]() -> HeightField {
    if (cost == MatchCost::Sad || cost == MatchCost::Ssd) {
      Sweeper::FullOptions options;
      options.cost = cost;
      options.window_levels = window;
      options.better_half = half;
      options.plane_step_m = step_m;
      return need(sweeper.runFull(grid, views.on_luma, options));
    }
    SweepOptions options;
    options.cost = cost;
    options.levels = 1;
    options.max_planes = static_cast<int>((grid.max_height_m - grid.min_height_m) / step_m) + 1;
    options.plane_step = 1e-3;  // as fine as the planes allow
    options.window_radius = window - 1;
    options.better_half = half;
    options.max_rival = 1;
    options.median_radius = 0;
    options.smooth_planes = 0;
    options.min_segment = 1;
    return need(sweeper.run(grid, cost == MatchCost::Zncc ? views.on_match : views.on_luma, options));
  };
  static_cast<void>(once());  // compiles
  const double begin = cpuSeconds();
  const HeightField field = once();
  const double cpu_s = cpuSeconds() - begin;
  const Summary s = summarise(site.errors(cell, field));
  return {cpu_s, s.nmad, static_cast<double>(s.measured) / static_cast<double>(cell.points.size())};
}

}  // namespace

void table(gl::Context& context, const std::string& flight, int texels) {
  const Site site(context, flight);
  const std::vector<Site::Cell> cells = site.cells(40, 8);
  if (cells.empty()) throw std::runtime_error("no cell is seen by eight frames and has 40 points");
  const Site::Cell& cell = cells[cells.size() / 2];
  const geo::TileFrame frame = site.frameOf(cell);
  const SweepGrid grid = site.grid(frame, texels);
  const auto sweeper = need(Sweeper::create(context));
  std::printf(
      "%s, a cell of %d x %d texels and 16 around it, heights from %.0f to %.0f m, %zu points; no filter. "
      "CPU seconds / NMAD in GSD\n",
      flight.c_str(), texels, texels, grid.min_height_m, grid.max_height_m, cell.points.size());
  std::vector<Site::Views> views;
  for (const std::size_t n : kImages) views.push_back(site.viewsOf(cell, n));
  for (const double step_m : {0.4, 0.2})
    for (const auto& [name, cost] :
         {std::pair{"SAD", MatchCost::Sad}, std::pair{"SSD", MatchCost::Ssd},
          std::pair{"ZNCC", MatchCost::Zncc}, std::pair{"census", MatchCost::Census}}) {
      const bool mips = cost == MatchCost::Sad || cost == MatchCost::Ssd;
      std::printf(
          "\n%s, planes every %.1f m\n\n| largest window | all: n = 2 | 4 | 6 | 8 | better half: n = 2 | 4 | "
          "6 | 8 |\n|---|---|---|---|---|---|---|---|---|\n",
          name, step_m);
      for (int window = 1; window <= 4; ++window) {
        const int width = mips ? 1 << (window - 1) : 2 * window - 1;
        std::printf("| %d x %d |", width, width);
        for (const bool half : {false, true})
          for (const Site::Views& set : views) {
            const Measured m = measure(site, *sweeper, cell, grid, set, cost, window, half, step_m);
            std::printf(" %.2f / %.2f |", m.cpu_s, m.nmad);
            std::fflush(stdout);
          }
        std::printf("\n");
      }
    }
  const RectifyTimes times = site.uploadTimes(cell, 8);
  std::printf(
      "\n8 frames to the GPU, apart from the sweep: decoding %.3f s, upload %.3f s, undistortion and mips "
      "%.3f s (wall)\n",
      times.decode_s, times.upload_s, times.gpu_s);
}

}  // namespace overfly::bench
