#include <benchmark/benchmark.h>

#include <ctime>

#include "tests/accuracy/adjust/run_recorded.h"

// Kind and size of features: processor time per frame against the accuracy that comes out, on brighton-beach
// from its raw telemetry. Arguments: kind (0 SIFT, 1 AKAZE, 2 ORB), long side of the reduced frame, most
// kept.
namespace overfly::tiling::adjust {
namespace {

double processorSeconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

void brightonBeach(benchmark::State& state) {
  const auto flight = RecordedFlight::read(OVERFLY_FLIGHTS_DIR "/brighton-beach");
  AdjusterOptions options;
  options.features.kind = static_cast<FeatureKind>(state.range(0));
  options.features.long_side_px = static_cast<int>(state.range(1));
  options.features.most = static_cast<int>(state.range(2));
  const auto image = flight.grey(3);
  for (auto _ : state) {
    const double start = processorSeconds();
    const auto features =
        findFeatures({image.bytes.data(), image.width, image.height, image.stride}, options.features);
    benchmark::DoNotOptimize(features.pixels.data());
    const double found = processorSeconds();
    const Outcome out = run(flight, flight.nominal(3.61, 1.55), false, options);
    state.counters["find_s"] = found - start;
    state.counters["cpu_s_per_frame"] =
        (processorSeconds() - found) / static_cast<double>(flight.frames.size());
    state.counters["adjusted"] = out.adjusted;
    state.counters["rms_px"] = out.summary.rms_px;
    state.counters["position_m"] = out.position_rms_m;
    state.counters["rotation_deg"] = out.rotation_rms_deg;
    state.counters["observations"] = out.summary.observations;
  }
}
BENCHMARK(brightonBeach)
    ->ArgsProduct({{0, 1, 2}, {800, 1000}, {2500}})
    ->Args({0, 800, 5000})
    ->Args({0, 1600, 5000})
    ->Iterations(1)
    ->Unit(benchmark::kSecond);

}  // namespace
}  // namespace overfly::tiling::adjust
