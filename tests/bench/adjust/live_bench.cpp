#include <benchmark/benchmark.h>

#include <algorithm>
#include <ctime>

#include "tests/unit/adjust/simulated_tracks.h"
#include "tiling/adjust/pose_map.h"

// Processor time per frame of the live adjustment (matching by truth, so without features) and its growth:
// median and 95th percentile of the first and of the last quarter of a long simulated flight.
namespace overfly::tiling::adjust {
namespace {

double processorSeconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double quantile(std::vector<double> v, double q) {
  std::sort(v.begin(), v.end());
  return v[static_cast<std::size_t>(q * static_cast<double>(v.size() - 1))];
}

void liveFrames(benchmark::State& state) {
  tests::SimulatedSettings settings;
  settings.frames_per_leg = 25;
  settings.legs = static_cast<int>(state.range(0)) / settings.frames_per_leg;
  settings.points_per_frame = 400;
  settings.gnss_noise_m = 2;
  settings.attitude_noise = 0.01;
  for (auto _ : state) {
    tests::SimulatedTracks tracks(settings);
    AdjustOptions options;
    PoseMap map(tracks.nominal, options);
    tests::TruthMatcher matcher(0.03);
    std::vector<double> seconds;
    double worst_m = 0;
    int adjusted = 0;
    for (int i = 0; i < tracks.frames(); ++i) {
      auto picture = tracks.take(i);
      auto pixels = picture.pixels;
      matcher.add(static_cast<FrameId>(i), std::move(picture));
      const auto prior = tracks.telemetry(i);
      const double start = processorSeconds();
      const auto updates = map.add(static_cast<FrameId>(i), prior, std::move(pixels), matcher);
      seconds.push_back(processorSeconds() - start);
      for (const auto& u : updates) {
        if (u.revision == 0 && u.state == FrameState::Adjusted) ++adjusted;
        if (u.id < 30) continue;  // before the first regional adjustments
        worst_m =
            std::max(worst_m, (u.position - tracks.at(tracks.time(static_cast<int>(u.id))).position).norm());
      }
    }
    const auto quarter = static_cast<std::ptrdiff_t>(seconds.size() / 4);
    const std::vector<double> first(seconds.begin(), seconds.begin() + quarter),
        last(seconds.end() - quarter, seconds.end());
    state.counters["first_median_s"] = quantile(first, 0.5);
    state.counters["first_p95_s"] = quantile(first, 0.95);
    state.counters["last_median_s"] = quantile(last, 0.5);
    state.counters["last_p95_s"] = quantile(last, 0.95);
    state.counters["adjusted"] = adjusted;
    state.counters["worst_m"] = worst_m;
  }
}
BENCHMARK(liveFrames)->Arg(100)->Arg(1000)->Iterations(1)->Unit(benchmark::kSecond);

}  // namespace
}  // namespace overfly::tiling::adjust
