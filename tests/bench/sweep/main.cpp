// What accuracy costs in the sweep, on a recorded flight:
//
//   bench_sweep proof FLIGHT [--tiles 6] [--seed 1]    coarse to fine against the full sweep
//   bench_sweep peak FLIGHT                            the full sweep against the device's peak of reads
//   bench_sweep borders FLIGHT                         height steps at the borders of tiles
//   bench_sweep table FLIGHT [--texels 128]            images x window x cost x better half x plane step
//
// Times are CPU seconds of this process (all threads): on a software rasteriser they are the work itself.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

#include "tests/bench/sweep/bench.h"
#include "tests/bench/sweep/site.h"

int main(int argc, char** argv) {
  CLI::App app("what accuracy costs in the sweep");
  app.require_subcommand(1);
  std::string flight;
  int tiles = 6, texels = 128;
  std::uint32_t seed = 1;
  CLI::App* proof = app.add_subcommand("proof", "coarse to fine against the full sweep");
  CLI::App* peak = app.add_subcommand("peak", "the full sweep against the device's peak of reads");
  CLI::App* table = app.add_subcommand("table", "images, windows, costs, plane steps");
  CLI::App* borders = app.add_subcommand("borders", "height steps at the borders of tiles");
  for (CLI::App* command : {proof, peak, table, borders})
    command->add_option("FLIGHT", flight, "folder of a flight with reference_points.csv")->required();
  proof->add_option("--tiles", tiles, "how many tiles");
  proof->add_option("--seed", seed, "chooses them");
  table->add_option("--texels", texels, "side of the swept cell");
  CLI11_PARSE(app, argc, argv);
  try {
    auto context = overfly::bench::need(overfly::gl::Context::create());
    if (proof->parsed()) return overfly::bench::proof(context, flight, tiles, seed) ? 0 : 1;
    if (borders->parsed()) return overfly::bench::borders(context, flight) ? 0 : 1;
    if (peak->parsed()) overfly::bench::peak(context, flight);
    if (table->parsed()) overfly::bench::table(context, flight, texels);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bench_sweep: %s\n", error.what());
    return 2;
  }
  return 0;
}
