#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/unit/adjust/simulated_tracks.h"
#include "tests/unit/adjust/textured_ground.h"
#include "tiling/adjust/adjuster.h"

// Time per frame of the live adjustment and its growth over a long simulated flight: median and 95th
// percentile of the first and of the last hundred frames. `liveTracks` has no pictures: matches by truth, so
// neither features nor the comparison of descriptors is in it. `livePictures` has both, in pictures of 320 x
// 240 pixels.
namespace overfly::tiling::adjust {
namespace {

constexpr std::size_t kCompared = 100;  // frames at either end
constexpr FrameId kSettled = 30;        // frames before the first regional adjustments: not judged

// Of the whole process: OpenCV's features may use several threads.
double processorSeconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double wallSeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double quantile(std::vector<double> v, double q) {
  std::sort(v.begin(), v.end());
  return v[static_cast<std::size_t>(q * static_cast<double>(v.size() - 1))];
}

class Times {
 public:
  // Runs and times one frame.
  template <class Work>
  void frame(const Work& work) {
    const double wall = wallSeconds(), cpu = processorSeconds();
    work();
    cpu_.push_back(processorSeconds() - cpu);
    wall_.push_back(wallSeconds() - wall);
  }

  void report(benchmark::State& state) const {
    for (const auto& [name, seconds] : {std::pair{"cpu", &cpu_}, std::pair{"wall", &wall_}}) {
      const auto n = static_cast<std::ptrdiff_t>(std::min(kCompared, seconds->size()));
      const std::vector<double> first(seconds->begin(), seconds->begin() + n),
          last(seconds->end() - n, seconds->end());
      const std::string unit = std::string("_") + name + "_s";
      state.counters["first_median" + unit] = quantile(first, 0.5);
      state.counters["first_p95" + unit] = quantile(first, 0.95);
      state.counters["last_median" + unit] = quantile(last, 0.5);
      state.counters["last_p95" + unit] = quantile(last, 0.95);
    }
  }

 private:
  std::vector<double> cpu_, wall_;
};

void liveTracks(benchmark::State& state) {
  tests::SimulatedSettings settings;
  settings.frames_per_leg = 25;
  settings.legs = static_cast<int>(state.range(0)) / settings.frames_per_leg;
  settings.points_per_frame = 400;
  settings.gnss_noise_m = 2;
  settings.attitude_noise = 0.01;
  for (auto _ : state) {
    tests::SimulatedTracks tracks(settings);
    PoseMap map(tracks.nominal, AdjustOptions{});
    tests::TruthMatcher matcher(0.03);
    Times times;
    double worst_m = 0;
    int adjusted = 0;
    for (int i = 0; i < tracks.frames(); ++i) {
      auto picture = tracks.take(i);
      auto pixels = picture.pixels;
      matcher.add(static_cast<FrameId>(i), std::move(picture));
      const auto prior = tracks.telemetry(i);
      std::vector<FrameUpdate> updates;
      times.frame([&] { updates = map.add(static_cast<FrameId>(i), prior, std::move(pixels), matcher); });
      for (const auto& u : updates) {
        if (u.revision == 0 && u.state == FrameState::Adjusted) ++adjusted;
        if (u.id < kSettled) continue;
        worst_m =
            std::max(worst_m, (u.position - tracks.at(tracks.time(static_cast<int>(u.id))).position).norm());
      }
    }
    times.report(state);
    state.counters["adjusted"] = adjusted;
    state.counters["worst_m"] = worst_m;
  }
}
BENCHMARK(liveTracks)->Arg(1000)->Iterations(1)->Unit(benchmark::kSecond);

void livePictures(benchmark::State& state) {
  for (auto _ : state) {
    tests::TexturedGround ground;
    auto& camera = ground.camera;
    camera.width = 320;
    camera.height = 240;
    camera.fx = camera.fy = 267;
    camera.cx = 160;
    camera.cy = 120;
    Adjuster adjuster(ground.camera, AdjusterOptions{});
    Times times;
    double worst_m = 0;
    int adjusted = 0;
    for (int i = 0; i < state.range(0); ++i) {
      const capture::FramePtr frame = ground.frame(i, 2, 0.01);
      const capture::Image& image = frame->image;
      std::vector<AdjustedPose> updates;
      times.frame([&] {
        auto added =
            adjuster.addFrame(static_cast<FrameId>(i),
                              {image.bytes.data(), image.width, image.height, image.stride}, *frame->pose);
        if (!added) throw std::runtime_error(added.error().message);
        updates = std::move(*added);
      });
      for (const auto& u : updates) {
        if (u.revision == 0 && u.state == FrameState::Adjusted) ++adjusted;
        if (u.id < kSettled) continue;
        worst_m = std::max(
            worst_m,
            (ground.positionOf(u.pose) - tests::TexturedGround::at(static_cast<int>(u.id)).position).norm());
      }
    }
    times.report(state);
    state.counters["adjusted"] = adjusted;
    state.counters["worst_m"] = worst_m;
  }
}
BENCHMARK(livePictures)->Arg(300)->Arg(1000)->Iterations(1)->Unit(benchmark::kSecond);

}  // namespace
}  // namespace overfly::tiling::adjust
