// Frames, filters and steps of the preview, and the same elevation as a rasterised mesh (the shape of the
// thesis's tables 4.2 and 4.3 and of DVT's table 1). Times are the process's CPU time over all its threads:
// on a software rasteriser the picture's cost whatever else the machine does; on a GPU read "real_time"
// instead.
//
//   bench_preview --benchmark_filter=Frame
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <map>
#include <memory>

#include "render/preview/previewer.h"
#include "tests/bench/preview/endless_map.h"
#include "tests/bench/preview/live_flight.h"
#include "tests/bench/preview/mesh_peer.h"
#include "tests/bench/preview/quantile.h"
#include "tests/unit/preview/photo_ring.h"

namespace overfly::bench {
namespace {

using preview::Filter;
using preview::Look;
using preview::Previewer;
using preview::Surface;
using preview::View;

gl::Context& context() {
  static gl::Context made = gl::Context::create().value();
  return made;
}

// A map of 1, 10 or 100 times the smallest area (0.3 km a side at 5 cm), with everything that the view calls
// for in GPU memory.
struct Scene {
  explicit Scene(int area)
      : map(static_cast<int>(std::lround(24 * std::sqrt(area))), 256),
        ram(map, {.budget_bytes = 512u << 20}),
        previewer(context(), ram) {}
  // The camera looks down on ground that the smallest map covers to the picture's edges ...
  void lookDown(int width, int height) { look(45, -0.87, width, height); }
  // ... or towards the horizon.
  void lookAhead(int width, int height) { look(60, -0.3, width, height); }
  EndlessMap map;
  preview::RamCache ram;
  Previewer previewer;
  View view;

 private:
  void look(double above, double pitch, int width, int height) {
    view.position = map.middle(EndlessMap::kGround + above);
    view.heading = 0.6;
    view.pitch = pitch;
    view.width = width;
    view.height = height;
  }
};

Scene& scene(std::int64_t area) {
  static std::map<std::int64_t, std::unique_ptr<Scene>> scenes;
  auto& made = scenes[area];
  if (!made) made = std::make_unique<Scene>(static_cast<int>(area));
  return *made;
}

constexpr int kSizes[][2] = {{320, 180}, {640, 360}, {1280, 720}};

bool settle(benchmark::State& state, Scene& s, const Look& look) {
  const auto frame = s.previewer.drawSettled(s.view, look);
  if (!frame) state.SkipWithError(frame.error().message.c_str());
  return frame.has_value();
}

void frames(benchmark::State& state, Scene& s, const Look& look) {
  if (!settle(state, s, look)) return;
  for (auto _ : state) {
    const auto drawn = s.previewer.caster().drawOnly(s.view, *s.previewer.frame(), look, *s.previewer.cache(),
                                                     *s.previewer.textures());
    if (!drawn) state.SkipWithError(drawn.error().message.c_str());
  }
  state.counters["gpu_MB"] = static_cast<double>(s.previewer.textures()->bytes()) * 1e-6;
  state.counters["fps"] =
      benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}

double difference(std::span<const std::uint8_t> a, std::span<const std::uint8_t> b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::abs(a[i] - b[i]);
  return sum / static_cast<double>(a.size());
}

Look plain(Surface surface = Surface::Linear, Filter filter = Filter::Trilinear) {
  Look look;
  look.surface = surface;
  look.filter = filter;
  look.relief = 0;
  return look;
}

void Frame(benchmark::State& state) {
  Scene& s = scene(state.range(0));
  s.lookDown(kSizes[state.range(1)][0], kSizes[state.range(1)][1]);
  frames(state, s, plain(static_cast<Surface>(state.range(2))));
}
BENCHMARK(Frame)
    ->ArgNames({"area", "size", "surface"})
    ->ArgsProduct({{1, 10, 100}, {0, 1, 2}, {0, 1, 2}})
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

// The whole map in the picture: what more of it costs, as a picture and by the pixels that show it
// ("ns_a_map_pixel": CPU time of all threads; "map_share": of the picture).
void Horizon(benchmark::State& state) {
  Scene& s = scene(state.range(0));
  s.lookAhead(640, 360);
  frames(state, s, plain());
  const auto seen = s.previewer.caster().draw(s.view, *s.previewer.frame(), plain(), *s.previewer.cache(),
                                              *s.previewer.textures(), true);
  if (!seen) return state.SkipWithError(seen.error().message.c_str());
  const auto shown = static_cast<double>(
      std::ranges::count_if(seen->hits, [](const preview::RayHit& hit) { return hit.found; }));
  state.counters["map_share"] = shown / static_cast<double>(seen->hits.size());
  state.counters["ns_a_map_pixel"] =
      benchmark::Counter(1e-9 * shown * static_cast<double>(state.iterations()),
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}
BENCHMARK(Horizon)->ArgName("area")->Arg(1)->Arg(10)->Arg(100)->MeasureProcessCPUTime()->Unit(
    benchmark::kMillisecond);

// Nearest, bilinear, trilinear, and anisotropic with up to N samples; how far the picture is from the
// trilinear one (mean difference of a channel, 0 .. 255).
void Filtering(benchmark::State& state) {
  Scene& s = scene(10);
  s.lookAhead(640, 360);
  Look look = plain(Surface::Linear, static_cast<Filter>(state.range(0)));
  look.max_anisotropy = static_cast<int>(state.range(1));
  frames(state, s, look);
  const auto draw = [&](const Look& how) {
    return s.previewer.caster().draw(s.view, *s.previewer.frame(), how, *s.previewer.cache(),
                                     *s.previewer.textures());
  };
  const auto shown = draw(look), trilinear = draw(plain());
  if (shown && trilinear) state.counters["from_trilinear"] = difference(shown->rgba, trilinear->rgba);
}
BENCHMARK(Filtering)
    ->ArgNames({"filter", "samples"})
    ->Args({0, 1})
    ->Args({1, 1})
    ->Args({2, 1})
    ->Args({3, 1})
    ->Args({3, 2})
    ->Args({3, 4})
    ->Args({3, 8})
    ->Args({3, 16})
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

// Cells that a ray looks at, with the maximum pyramid and without (the finest level throughout).
void Steps(benchmark::State& state) {
  Scene& s = scene(10);
  if (state.range(2) != 0)
    s.lookAhead(320, 180);
  else
    s.lookDown(320, 180);
  Look look = plain();
  look.level_of_detail = state.range(1) != 0;
  s.previewer.caster().usePyramid(true);
  if (!settle(state, s, look)) return;
  s.previewer.caster().usePyramid(state.range(0) != 0);
  double steps = 0, rays = 0;
  for (auto _ : state) {
    const auto picture = s.previewer.caster().draw(s.view, *s.previewer.frame(), look, *s.previewer.cache(),
                                                   *s.previewer.textures(), true);
    if (!picture) {
      state.SkipWithError(picture.error().message.c_str());
      break;
    }
    steps = rays = 0;
    for (const preview::RayHit& hit : picture->hits) {
      steps += hit.steps;
      ++rays;
    }
  }
  s.previewer.caster().usePyramid(true);
  state.counters["steps_per_ray"] = steps / std::max(rays, 1.0);
}
BENCHMARK(Steps)
    ->ArgNames({"pyramid", "levels", "horizon"})
    ->ArgsProduct({{1}, {0, 1}, {0, 1}})
    ->ArgsProduct({{0}, {0}, {0, 1}})
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

// The peer: the same elevation as a mesh, the same colours. "error": mean difference of a channel (0 .. 255)
// from the ray caster's picture of the finest level with 16 rays a pixel, for the mesh and for the ray
// caster's frame of Frame/10/SIZE/1.
void Mesh(benchmark::State& state) {
  Scene& s = scene(10);
  const int width = kSizes[state.range(0)][0], height = kSizes[state.range(0)][1];
  s.lookDown(width, height);
  const Look look = plain();
  if (!settle(state, s, look)) return;
  auto peer = MeshPeer::create(context(), *s.previewer.textures(), 256);
  if (!peer) {
    state.SkipWithError(peer.error().message.c_str());
    return;
  }
  std::size_t triangles = 0;
  const auto draw = [&] {
    const auto drawn = peer->draw(context(), s.view, *s.previewer.frame(), *s.previewer.cache(),
                                  *s.previewer.textures(), static_cast<double>(state.range(1)) / 10);
    if (!drawn) state.SkipWithError(drawn.error().message.c_str());
    triangles = drawn.value_or(0);
    return drawn.has_value();
  };
  if (!draw()) return;  // compiles
  for (auto _ : state)
    if (!draw()) return;
  const auto mesh = peer->read();
  const auto rays = s.previewer.caster().draw(s.view, *s.previewer.frame(), look, *s.previewer.cache(),
                                              *s.previewer.textures());
  s.lookDown(4 * width, 4 * height);
  Look exact = look;
  exact.level_of_detail = false;
  const auto fine = s.previewer.drawSettled(s.view, exact);
  if (!mesh || !rays || !fine) return;
  std::vector<std::uint8_t> finest(mesh->size());
  for (std::size_t y = 0; y < static_cast<std::size_t>(height); ++y) {
    for (std::size_t x = 0; x < static_cast<std::size_t>(width); ++x) {
      for (std::size_t c = 0; c < 4; ++c) {
        unsigned sum = 8;
        for (std::size_t k = 0; k < 16; ++k)
          sum += fine->picture
                     .rgba[4 * ((4 * y + k / 4) * 4 * static_cast<std::size_t>(width) + 4 * x + k % 4) + c];
        finest[4 * (y * static_cast<std::size_t>(width) + x) + c] = static_cast<std::uint8_t>(sum / 16);
      }
    }
  }
  state.counters["triangles_per_pixel"] =
      static_cast<double>(triangles) / (static_cast<double>(width) * height);
  state.counters["mesh_error"] = difference(*mesh, finest);
  state.counters["ray_error"] = difference(rays->rgba, finest);
}
BENCHMARK(Mesh)
    ->ArgNames({"size", "tenths_of_a_pixel"})
    ->ArgsProduct({{0, 1, 2}, {15, 10, 5}})
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

double cpuMilliseconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}

// What photographs on steep sides cost (thesis, 6.3.1): pictures with none and with some in turn, CPU time of
// each. "everywhere": they colour all of the surface, not its sides alone. "changed": share of the pixels.
void Lateral(benchmark::State& state) {
  Scene& s = scene(10);
  s.lookDown(640, 360);
  const auto middle = s.view.position;
  std::vector<View> cameras;
  for (int i = 0; i < 8; ++i) {
    View camera = s.view;
    camera.heading = s.view.heading + geo::radians(-40 + 80.0 * i / 7);
    camera.pitch = -0.7;
    const geo::LocalFrame local(middle);
    camera.position = geo::geodeticFromEcef(
        local.ecefFromEnu({-25 + 50 * std::sin(0.9 * i), -15 + 45 * std::cos(1.7 * i), -10 + 2.0 * i}));
    camera.width = 1024;
    camera.height = 768;
    cameras.push_back(camera);
  }
  test::PhotoRing photos(cameras, [](double u, double v, std::size_t) {
    return test::PhotoRing::Rgb{static_cast<std::uint8_t>(255 * u), static_cast<std::uint8_t>(255 * v), 40};
  });
  Look look = plain(), projected = plain();
  projected.projectors = static_cast<int>(state.range(0));
  if (state.range(1) != 0) projected.lateral_slope = 0;
  s.previewer.setProjectors(&photos);
  if (!settle(state, s, projected)) return;
  const auto draw = [&](const Look& how) {
    const double begin = cpuMilliseconds();
    const auto drawn = s.previewer.caster().drawOnly(s.view, *s.previewer.frame(), how, *s.previewer.cache(),
                                                     *s.previewer.textures());
    if (!drawn) state.SkipWithError(drawn.error().message.c_str());
    return cpuMilliseconds() - begin;
  };
  static_cast<void>(draw(look));  // compiles
  double without = 0, with = 0;
  for (auto _ : state) {
    without += draw(look);
    with += draw(projected);
  }
  const auto shown = [&](const Look& how) {
    return s.previewer.caster().draw(s.view, *s.previewer.frame(), how, *s.previewer.cache(),
                                     *s.previewer.textures());
  };
  const auto a = shown(look), b = shown(projected);
  if (a && b) {
    std::size_t changed = 0;
    for (std::size_t i = 0; i < a->rgba.size(); i += 4)
      changed += std::equal(&a->rgba[i], &a->rgba[i] + 3, &b->rgba[i]) ? 0 : 1;
    state.counters["changed"] = 4.0 * static_cast<double>(changed) / static_cast<double>(a->rgba.size());
  }
  const auto count = static_cast<double>(state.iterations());
  state.counters["ms_without"] = without / count;
  state.counters["ms_with"] = with / count;
  state.counters["ratio"] = with / without;
  s.previewer.setProjectors(nullptr);
  s.previewer.caster().project(nullptr);
}
BENCHMARK(Lateral)
    ->ArgNames({"projectors", "everywhere"})
    ->ArgsProduct({{0, 1, 2, 4, 8}, {0, 1}})
    ->Iterations(5)
    ->Unit(benchmark::kMillisecond);

// DVT's setting: 3 ms for updates a frame, on a flight of 1.7 cm a frame over tiles that live 1 s and may be
// drawn 1 s longer, read by a thread of their own. Of an update: wall time, and CPU time of the thread that
// draws. "coarser": share of the frames with a coarser level in the picture's middle than at first.
void Uploads(benchmark::State& state) {
  Scene s(10);
  s.lookDown(320, 180);
  const Look look = plain();
  s.map.life = std::chrono::seconds(1);
  s.map.grace = std::chrono::seconds(1);
  if (!settle(state, s, look)) return;
  const auto middle = [&s] { return s.previewer.cache()->finestAt(s.previewer.frame()->cell); };
  const int finest = middle();
  s.ram.startLoading(std::chrono::milliseconds(250));
  preview::ClipCache::Budget budget;
  budget.time = std::chrono::milliseconds(3);
  budget.aside = state.range(0) != 0;
  double uploads = 0, coarser = 0, over = 0;
  std::vector<double> wall, cpu;
  View view = s.view;
  const auto begin = preview::Clock::now();
  for (auto _ : state) {
    view.position.lat += 2.7e-9;
    const auto before = preview::Clock::now();
    const double cpu_before = threadMilliseconds();
    const auto update = s.previewer.refine(view, look, budget);
    cpu.push_back(threadMilliseconds() - cpu_before);
    wall.push_back(std::chrono::duration<double, std::milli>(preview::Clock::now() - before).count());
    over += wall.back() > 3 ? 1 : 0;
    const auto drawn = s.previewer.caster().drawOnly(view, *s.previewer.frame(), look, *s.previewer.cache(),
                                                     *s.previewer.textures());
    if (!update || !drawn) {
      state.SkipWithError((update ? drawn.error() : update.error()).message.c_str());
      return;
    }
    uploads += update->uploads;
    coarser += middle() > finest ? 1 : 0;
  }
  const double seconds = std::chrono::duration<double>(preview::Clock::now() - begin).count();
  const auto count = static_cast<double>(wall.size());
  state.counters["fps"] = count / seconds;
  state.counters["tiles_a_second"] = uploads / seconds;
  state.counters["coarser"] = coarser / count;
  state.counters["beyond_3_ms"] = over / count;
  for (const auto& [name, share] : kShares) {
    state.counters[std::string("wall_ms_") + name] = quantile(wall, share);
    state.counters[std::string("cpu_ms_") + name] = quantile(cpu, share);
  }
}
BENCHMARK(Uploads)->ArgName("aside")->Arg(0)->Arg(1)->Iterations(300)->UseRealTime()->Unit(
    benchmark::kMillisecond);

}  // namespace
}  // namespace overfly::bench
