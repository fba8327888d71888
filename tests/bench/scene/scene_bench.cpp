// Cost of a simulated frame: the six scenes as they ship, each effect alone and all together on the village,
// and the passes of the plants' selection (Amara et al., table 1). Every frame is waited for.
#include <benchmark/benchmark.h>

#include <memory>
#include <numbers>

#include "render/amplify/selector.h"
#include "render/scene/renderer.h"

namespace overfly::scene {
namespace {

void renderFrames(benchmark::State& state, const SceneDescription& description) {
  const auto world = buildWorld(description);
  auto context = gl::Context::create();
  if (!world || !context) return state.SkipWithError("no scene or no OpenGL ES 3.1");
  auto renderer = Renderer::create(*context, *world);
  if (!renderer) return state.SkipWithError(renderer.error().message.c_str());
  int frame = 0;
  for (auto _ : state) {
    auto picture = (*renderer)->render(frame++ % (*renderer)->path().frames());
    if (!picture) return state.SkipWithError(picture.error().message.c_str());
    benchmark::DoNotOptimize(picture->rgb.data());
  }
  state.counters["passes"] = static_cast<double>((*renderer)->lastCost().passes.size());
  state.counters["plants"] = static_cast<double>((*renderer)->lastCost().plants);
  state.counters["triangles"] = static_cast<double>((*renderer)->lastCost().triangles);
  state.counters["flight_s_per_frame"] =
      (*renderer)->path().duration() / std::max(1, (*renderer)->path().frames() - 1);
}

void shippedScene(benchmark::State& state, const char* name) {
  const auto description = loadScene(std::string(OVERFLY_SOURCE_DIR "/tests/data/scenes/") + name + ".toml");
  if (!description) return state.SkipWithError(description.error().message.c_str());
  renderFrames(state, *description);
}

// -1: none, kEffectCount: all.
void villageWithEffect(benchmark::State& state) {
  auto description = loadScene(OVERFLY_SOURCE_DIR "/tests/data/scenes/village.toml");
  if (!description) return state.SkipWithError(description.error().message.c_str());
  description->effects.clear();
  for (int i = 0; i < kEffectCount; ++i) {
    if (state.range(0) == i || state.range(0) == kEffectCount) {
      description->effects.push_back(defaultSettings(static_cast<Effect>(i), description->seed));
    }
  }
  state.SetLabel(state.range(0) < 0 ? "none"
                 : state.range(0) == kEffectCount
                     ? "all"
                     : std::string(infoOf(static_cast<Effect>(state.range(0))).name));
  renderFrames(state, *description);
}

// A square of forest, 1.5 km a side, seen from 120 m at 45 degrees: tens of thousands of plants a frame.
void plantSelection(benchmark::State& state) {
  constexpr int kSide = 1536;
  amplify::Population population;
  population.patterns = amplify::SeedPatterns(population.seed);
  population.cover =
      amplify::LandCover(-kSide / 2, -kSide / 2, kSide, kSide,
                         std::vector<amplify::Species>(kSide * kSide, amplify::Species::Broadleaf));
  population.rules[1] = {static_cast<int>(state.range(0)), 6, 15, 0.36f, 1.0f, 10000};
  const std::vector<float> heights(97 * 97, 0.0f);
  auto context = gl::Context::create();
  if (!context) return state.SkipWithError("no OpenGL ES 3.1");
  auto selector =
      amplify::PlantSelector::create(*context, population, {{-768, -768}, 16, 97, 97, heights}, 300000);
  if (!selector) return state.SkipWithError(selector.error().message.c_str());
  amplify::PlantView view;
  view.eye = {0, -700, 120};
  view.rings = {840, 1680, 3600};
  const double c = std::numbers::sqrt2 / 2;
  view.planes = {Eigen::Vector4d(0.83, 0.39, -0.39, 0),
                 {-0.83, 0.39, -0.39, 0},
                 {0, 0.2, -0.98, 0},
                 {0, 0.98, -0.2, 0},
                 {0, c, -c, 0},
                 {0, c, -c, 0}};
  for (Eigen::Vector4d& plane : view.planes) plane.w() = -plane.head<3>().dot(view.eye);
  int chosen = 0;
  for (auto _ : state) {
    const auto counts = selector->select(view);
    if (!counts) return state.SkipWithError(counts.error().message.c_str());
    chosen = 0;
    for (const int count : *counts) chosen += count;
  }
  state.counters["selected"] = chosen;
  state.counters["seeds"] = static_cast<double>(selector->tiles() * amplify::SeedPatterns::kSeeds);
}

BENCHMARK_CAPTURE(shippedScene, field, "field")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(shippedScene, village, "village")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(shippedScene, city, "city")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(shippedScene, forest, "forest")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(shippedScene, canyon, "canyon")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(shippedScene, harbour, "harbour")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(villageWithEffect)->DenseRange(-1, kEffectCount)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(plantSelection)->Arg(22)->Arg(61)->Arg(128)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace overfly::scene
