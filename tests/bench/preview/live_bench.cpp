// A flight over a map file whose tiles are replaced meanwhile, in real time: how long the updates of GPU
// memory hold the thread that draws up, against their budget of 3 ms, and whether anything is missing or
// flickers.
//
//   bench_preview --benchmark_filter=LiveFlight
#include <benchmark/benchmark.h>

#include "tests/bench/preview/live_flight.h"
#include "tests/bench/preview/quantile.h"

namespace overfly::bench {
namespace {

// "tiles": of the finest level, replaced a second; "aside": images are made on a thread of the cache's own.
// "beyond_3_ms": share of the updates by the wall clock; "undisturbed_beyond_3_ms": of those in which the
// thread kept its core. "coarser": share of the pixels drawn coarser than
// their distance calls for.
void LiveFlight(benchmark::State& state) {
  static gl::Context context = gl::Context::create().value();
  static ChangingMapFile map;
  preview::ClipCache::Budget budget;
  budget.time = std::chrono::milliseconds(3);
  budget.aside = state.range(1) != 0;
  for (auto _ : state) {
    auto flown = flyOver(context, map, static_cast<int>(state.range(0)), 12, budget);
    if (!flown) {
      state.SkipWithError(flown.error().message.c_str());
      return;
    }
    LiveFigures& f = *flown;
    const auto count = static_cast<double>(f.frames), pixels = static_cast<double>(f.pixels);
    state.counters["fps"] = count / f.seconds;
    state.counters["written_a_second"] = f.written / f.seconds;
    state.counters["uploads_a_second"] = f.uploads / f.seconds;
    state.counters["pictures"] = count;
    state.counters["holes"] = static_cast<double>(f.holes);
    state.counters["flickers"] = static_cast<double>(f.flickers);
    state.counters["coarser"] = static_cast<double>(f.coarser) / pixels;
    state.counters["pictures_after"] = f.pictures_after;
    state.counters["beyond_3_ms"] =
        static_cast<double>(std::ranges::count_if(f.wall_ms, [](double ms) { return ms > 3; })) / count;
    double undisturbed = 0, long_ones = 0;
    for (std::size_t i = 0; i < f.wall_ms.size(); ++i) {
      if (f.interrupted[i]) continue;
      ++undisturbed;
      long_ones += f.wall_ms[i] > 3 ? 1 : 0;
    }
    state.counters["undisturbed"] = undisturbed / count;
    state.counters["undisturbed_beyond_3_ms"] = long_ones / std::max(undisturbed, 1.0);
    state.counters["cpu_beyond_3_ms"] =
        static_cast<double>(std::ranges::count_if(f.cpu_ms, [](double ms) { return ms > 3; })) / count;
    for (const auto& [name, share] : kShares) {
      state.counters[std::string("wall_ms_") + name] = quantile(f.wall_ms, share);
      state.counters[std::string("cpu_ms_") + name] = quantile(f.cpu_ms, share);
      state.counters[std::string("picture_ms_") + name] = quantile(f.picture_ms, share);
    }
  }
}
BENCHMARK(LiveFlight)
    ->ArgNames({"tiles", "aside"})
    ->Args({0, 1})
    ->Args({50, 1})
    ->Args({50, 0})
    ->Iterations(1)
    ->UseRealTime()
    ->Unit(benchmark::kSecond);

}  // namespace
}  // namespace overfly::bench
