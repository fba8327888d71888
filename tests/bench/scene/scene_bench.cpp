// Cost of a simulated frame: the six scenes as they ship, each effect alone and all together on the village,
// and the passes of the plants' selection (Amara et al., table 1). Every frame is waited for. Beside the time
// on the clock stands the processor time of all threads, which other work on the machine changes less.
#include <benchmark/benchmark.h>
#include <time.h>

#include <array>
#include <memory>
#include <numeric>
#include <string>

#include "capture/geo/footprint.h"
#include "render/amplify/selector.h"
#include "render/scene/renderer.h"

namespace overfly::scene {
namespace {

constexpr int kFrames = 4;  // a run

void renderFrames(benchmark::State& state, const SceneDescription& description) {
  const auto world = buildWorld(description);
  auto context = gl::Context::create();
  if (!world || !context) return state.SkipWithError("no scene or no OpenGL ES 3.1");
  auto renderer = Renderer::create(*context, *world);
  if (!renderer) return state.SkipWithError(renderer.error().message.c_str());
  // Shaders are compiled by the first frame; the measured ones are spread over the flight.
  const int frames = (*renderer)->path().frames();
  if (!(*renderer)->render(0)) return state.SkipWithError("no frame");
  int measured = 0;
  for (auto _ : state) {
    auto picture = (*renderer)->render((2 * measured++ + 1) * frames / (2 * kFrames) % frames);
    if (!picture) return state.SkipWithError(picture.error().message.c_str());
    benchmark::DoNotOptimize(picture->rgb.data());
  }
  state.counters["passes"] = static_cast<double>((*renderer)->lastCost().passes.size());
  state.counters["plants"] = static_cast<double>((*renderer)->lastCost().plants);
  state.counters["triangles"] = static_cast<double>((*renderer)->lastCost().triangles);
  state.counters["flight_s_per_frame"] = (*renderer)->path().duration() / std::max(1, frames - 1);
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

// The paper's table 1 (Amara et al.): three viewpoints over 21,000 trees a square kilometre, two resolutions,
// milliseconds of each pass on the processor (all threads together), selected and checked seeds a frame. Its
// pass 2 (ground texture) and the terrain's mesh are one here, the ground's drawing without plants; pass 4 is
// what drawing the plants adds to it.
struct Viewpoint {
  const char* name;
  double north, height_m, pitch_deg;  // -90: straight down
};
constexpr std::array<Viewpoint, 3> kViewpoints{{{"oblique from 120 m", -600, 120, -35},
                                                {"oblique from 300 m", -700, 300, -30},
                                                {"nadir from 150 m", 0, 150, -90}}};

std::shared_ptr<const World> forest(int width, int height, bool trees) {
  std::string text =
      "base = \"forest\"\n[place]\nlat_deg = 47\nlon_deg = 9\nheight_m = 500\n"
      "[terrain]\nkind = \"fractal\"\nextent = [1500, 1500]\nspacing = 8\nrelief = 30\nfeature = 400\n";
  if (trees) text += "[[vegetation]]\nspecies = \"broadleaf\"\nper_hectare = 210\nheight = [6, 15]\n";
  text += "[camera]\nwidth = " + std::to_string(width) + "\nheight = " + std::to_string(height) +
          "\nfx = " + std::to_string(width) + "\n[path]\nheight = 120\n";
  const auto description = parseScene(text, "forest");
  return description ? buildWorld(*description).value_or(nullptr) : nullptr;
}

// Processor time of all threads so far, milliseconds.
double processorMilliseconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

// Mean processor time of a frame from a viewpoint, milliseconds; the first compiles the shaders.
double costOf(Renderer& renderer, const CameraState& state) {
  double start = 0;
  for (int i = 0; i <= kFrames; ++i) {
    if (i == 1) start = processorMilliseconds();
    if (!renderer.render(state, {}, 0, 0)) return -1;
  }
  return (processorMilliseconds() - start) / kFrames;
}

void amplification(benchmark::State& state) {
  const Viewpoint& viewpoint = kViewpoints[static_cast<std::size_t>(state.range(0))];
  const int width = state.range(1) == 1 ? 1280 : 1024, height = state.range(1) == 1 ? 1024 : 768;
  const auto world = forest(width, height, true), bare = forest(width, height, false);
  auto context = gl::Context::create();
  if (!world || !bare || !context) return state.SkipWithError("no scene or no OpenGL ES 3.1");
  auto renderer = Renderer::create(*context, world);
  auto without = Renderer::create(*context, bare);
  auto selector = amplify::PlantSelector::create(*context, world->population, world->terrain.grid(),
                                                 static_cast<int>(world->plants.size()) + 64);
  if (!renderer || !without || !selector) return state.SkipWithError("no renderer");
  selector->measure(true);

  CameraState camera;
  camera.position = {0, viewpoint.north, viewpoint.height_m};
  camera.enu_from_camera = geo::enuFromCamera(0, geo::radians(viewpoint.pitch_deg), 0);
  amplify::PlantView view;
  view.eye = camera.position;
  view.rings = 1.2 * Eigen::Vector3d(700, 1400, 3000);
  const double f = width;
  const std::array<Eigen::Vector3d, 6> inward{{{f, 0, 0.5 * width},
                                               {-f, 0, 0.5 * width},
                                               {0, f, 0.5 * height},
                                               {0, -f, 0.5 * height},
                                               {0, 0, 1},
                                               {0, 0, 1}}};
  for (std::size_t i = 0; i < inward.size(); ++i) {
    const Eigen::Vector3d normal = camera.enu_from_camera * inward[i].normalized();
    view.planes[i] = {normal.x(), normal.y(), normal.z(), -normal.dot(camera.position)};
  }

  // What both passes take is measured on the processor, and shared between them as on the clock.
  if (!selector->select(view)) return state.SkipWithError("no selection");
  int selected = 0;
  double load_map = 0, seeds = 0;
  const double start = processorMilliseconds();
  for (auto _ : state) {
    const auto counts = selector->select(view);
    if (!counts) return state.SkipWithError(counts.error().message.c_str());
    selected = std::accumulate(counts->begin(), counts->end(), 0);
    load_map += selector->lastCost().load_map_ms;
    seeds += selector->lastCost().select_ms + selector->lastCost().compact_ms;
  }
  const double selection = (processorMilliseconds() - start) / static_cast<double>(state.iterations());
  const double ground = costOf(**without, camera), all = costOf(**renderer, camera);
  state.SetLabel(viewpoint.name);
  state.counters["ground_ms"] = ground;
  state.counters["pass1_ms"] = selection * load_map / (load_map + seeds);
  state.counters["pass3_ms"] = selection * seeds / (load_map + seeds);
  state.counters["pass4_ms"] = all - ground - selection;
  state.counters["selected"] = selected;
  state.counters["checked"] = static_cast<double>(selector->lastCost().checked_seeds);
}

const auto ofFrames = [](auto* benchmark) {
  benchmark->Iterations(kFrames)->Unit(benchmark::kMillisecond)->UseRealTime()->MeasureProcessCPUTime();
};
BENCHMARK_CAPTURE(shippedScene, field, "field")->Apply(ofFrames);
BENCHMARK_CAPTURE(shippedScene, village, "village")->Apply(ofFrames);
BENCHMARK_CAPTURE(shippedScene, city, "city")->Apply(ofFrames);
BENCHMARK_CAPTURE(shippedScene, forest, "forest")->Apply(ofFrames);
BENCHMARK_CAPTURE(shippedScene, canyon, "canyon")->Apply(ofFrames);
BENCHMARK_CAPTURE(shippedScene, harbour, "harbour")->Apply(ofFrames);
BENCHMARK(villageWithEffect)->DenseRange(-1, kEffectCount)->Apply(ofFrames);
BENCHMARK(amplification)
    ->ArgNames({"viewpoint", "resolution"})
    ->ArgsProduct({{0, 1, 2}, {1, 2}})
    ->Apply(ofFrames);

}  // namespace
}  // namespace overfly::scene
