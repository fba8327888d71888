#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>

#include "tests/bench/sweep/bench.h"
#include "tests/bench/sweep/site.h"

namespace overfly::bench {

using namespace overfly::tiling;

bool proof(gl::Context& context, const std::string& flight, int tiles, std::uint32_t seed) {
  const Site site(context, flight);
  std::vector<Site::Cell> cells = site.cells(40, 4);
  std::mt19937 random(seed);
  std::shuffle(cells.begin(), cells.end(), random);
  cells.resize(std::min(cells.size(), static_cast<std::size_t>(tiles)));
  const auto sweeper = need(Sweeper::create(context));
  SweepOptions coarse_to_fine, full;
  full.levels = 1;
  full.max_planes = 100000;
  std::printf("%s, seed %u: samples in millions, errors in GSD\n\n", flight.c_str(), seed);
  std::printf(
      "| cell | views | points | full: samples | NMAD | CPU s | coarse to fine: samples | NMAD | CPU s | "
      "fewer samples |\n");
  std::printf("|---|---|---|---|---|---|---|---|---|---|\n");
  std::vector<double> all_full, all_coarse;
  double samples_full = 0, samples_coarse = 0;
  for (const Site::Cell& cell : cells) {
    const geo::TileFrame frame = site.frameOf(cell);
    const SweepGrid grid = site.grid(frame, 256);
    const Site::Views views = site.viewsOf(cell, SweepOptions::kMaxViews);
    const auto run = [&](const SweepOptions& options, double& cpu_s) {
      const double begin = cpuSeconds();
      HeightField field = need(sweeper->run(grid, views.on_match, options));
      cpu_s = cpuSeconds() - begin;
      return field;
    };
    double full_s = 0, coarse_s = 0;
    const HeightField a = run(full, full_s), b = run(coarse_to_fine, coarse_s);
    const std::vector<double> of_full = site.errors(cell, a), of_coarse = site.errors(cell, b);
    // Seven planes at a time overlap by two: a full sweep proper reads each plane once.
    const double planes = std::ceil((grid.max_height_m - grid.min_height_m) / a.plane_step_m) + 1;
    const double views_used = static_cast<double>(std::min<std::size_t>(views.on_match.size(), 12));
    const double reads = planes * views_used * a.side() * a.side();
    std::printf("| %lld, %lld | %.0f | %zu | %.0f | %.3f | %.1f | %.1f | %.3f | %.1f | %.1f |\n",
                static_cast<long long>(cell.key.x), static_cast<long long>(cell.key.y), views_used,
                cell.points.size(), reads / 1e6, summarise(of_full).nmad, full_s,
                static_cast<double>(b.samples) / 1e6, summarise(of_coarse).nmad, coarse_s,
                reads / static_cast<double>(b.samples));
    std::fflush(stdout);
    samples_full += reads;
    samples_coarse += static_cast<double>(b.samples);
    all_full.insert(all_full.end(), of_full.begin(), of_full.end());
    all_coarse.insert(all_coarse.end(), of_coarse.begin(), of_coarse.end());
  }
  const Summary f = summarise(all_full), c = summarise(all_coarse);
  const double fewer = samples_full / samples_coarse;
  std::printf(
      "\nall: %.1f times fewer samples; NMAD %.3f (full, %zu of %zu points) and %.3f (coarse to fine, %zu): "
      "%+.1f %%\n",
      fewer, f.nmad, f.measured, all_full.size(), c.nmad, c.measured, 100 * (c.nmad / f.nmad - 1));
  return fewer >= 20 && c.nmad <= 1.05 * f.nmad;
}

}  // namespace overfly::bench
