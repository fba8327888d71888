// The device's own peak of bilinear reads, against which the sweep is judged.
//
//   bench_gl --benchmark_min_time=0.3
//
// Figures: Mfetch/s of wall time; Mfetch/cpu_s: per second of CPU time of this process over all its threads
// (on a software rasteriser the rate of one core, whatever else runs on the machine).
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <cstdint>
#include <map>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>

#include "bench_gl_shaders.h"
#include "render/gl/commands.h"

namespace overfly::gl {
namespace {

constexpr int kSource = 2048;  // pixels a side; R8: 4 MB, beyond the second-level cache as frames are
constexpr int kTarget = 512;
constexpr int kReads = 32;

Context& context() {
  static const auto made = [] {
    auto result = Context::create();
    if (!result) throw std::runtime_error(result.error().message);
    return std::make_unique<Context>(std::move(*result));
  }();
  return *made;
}

template <typename T>
T need(Result<T> result) {
  if (!result) throw std::runtime_error(result.error().message);
  return std::move(*result);
}

double cpuSeconds() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

const Texture& source(Format format, int layers) {
  static std::map<std::pair<Format, int>, Texture> known;
  auto [at, fresh] = known.try_emplace({format, layers});
  if (fresh) {
    at->second = need(Texture::create(context(), {format, kSource, kSource, layers, 2}));
    std::mt19937 random(1);
    const std::size_t count = std::size_t{kSource} * kSource * static_cast<std::size_t>(channels(format));
    for (int layer = 0; layer < std::max(1, layers); ++layer) {
      if (bytesPerTexel(format) == static_cast<std::size_t>(channels(format))) {
        std::vector<std::uint8_t> texels(count);
        for (auto& texel : texels) texel = static_cast<std::uint8_t>(random());
        at->second.upload(std::span<const std::uint8_t>(texels), 0, layer);
      } else if (format == Format::R32UI) {
        std::vector<std::uint32_t> texels(count);
        for (auto& texel : texels) texel = static_cast<std::uint32_t>(random());
        at->second.upload(std::span<const std::uint32_t>(texels), 0, layer);
      } else {
        std::vector<float> texels(count);
        for (auto& texel : texels) texel = static_cast<float>(random() & 255u) / 255.0f;
        at->second.upload(std::span<const float>(texels), 0, layer);
      }
    }
    if (context().info().support(format).filterable) at->second.generateMips();
  }
  return at->second;
}

const Buffer& storageSource() {
  static const Buffer made = [] {
    std::mt19937 random(1);
    std::vector<std::uint32_t> words(std::size_t{kSource} * kSource);  // Storage needs a quarter of it
    for (auto& word : words) word = static_cast<std::uint32_t>(random());
    return need(Buffer::from<std::uint32_t>(context(), words));
  }();
  return made;
}

enum Method { Sample, Gather, Texel, Storage, Nearest, Level, Quad, QuadWord, QuadStorage };

bool isScalar(Method method) {
  return method != Sample && method != Texel && method != Nearest && method != Level;
}

struct Case {
  Method method = Sample;
  Format format = Format::R8;
  int local_x = 0, local_y = 0;  // 0: a fragment pass
  int layers = 0;
};

std::vector<Define> defines(const Case& c) {
  const bool scalar = channels(c.format) == 1 || isScalar(c.method);
  std::vector<Define> out{{"METHOD", std::to_string(c.method)},
                          {"READS", std::to_string(kReads)},
                          {"VALUE", scalar ? "float" : "vec4"}};
  if (c.layers > 0) out.push_back({"LAYERED"});
  if (c.local_x > 0) {
    out.push_back({"LOCAL_X", std::to_string(c.local_x)});
    out.push_back({"LOCAL_Y", std::to_string(c.local_y)});
  }
  return out;
}

template <typename Draw>
void measure(benchmark::State& state, double items, const char* unit, Draw draw) {
  draw();
  context().finish();
  double cpu = 0;
  std::int64_t runs = 0;
  for (auto _ : state) {
    const double begin = cpuSeconds();
    draw();
    context().finish();
    cpu += cpuSeconds() - begin;
    ++runs;
  }
  const double millions = items * static_cast<double>(runs) * 1e-6;
  state.counters[std::string("M") + unit + "/s"] = benchmark::Counter(millions, benchmark::Counter::kIsRate);
  state.counters[std::string("M") + unit + "/cpu_s"] = millions / cpu;
  if (const auto errors = context().takeErrors(); !errors.empty()) state.SkipWithError(errors[0].c_str());
}

void fetch(benchmark::State& state, Case c) {
  namespace files = shaders::bench_gl;
  const ShaderFile common{"fetch.glsl", files::fetch_glsl};
  const bool compute = c.local_x > 0;
  const std::array<ShaderFile, 2> list{common, compute ? ShaderFile{"fetch.comp", files::fetch_comp}
                                                       : ShaderFile{"fetch.frag", files::fetch_frag}};
  Program program = need(compute ? Program::compute(context(), list, defines(c))
                                 : Program::fullScreen(context(), list, defines(c)));
  const Texture target = need(Texture::create(context(), {Format::RGBA16F, kTarget, kTarget}));
  Framebuffer framebuffer = need(Framebuffer::create(context(), target));
  if (c.method == Storage || c.method == QuadStorage) {
    storageSource().bindStorage(1);
    program.set("row_words", c.method == Storage ? kSource / 4 : kSource);
  } else {
    program.setTexture("source", 1, source(c.format, c.layers));
    program.set("inverse_size", Eigen::Vector2f(1.0f / kSource, 1.0f / kSource));
  }
  program.set("along", Eigen::Vector2f(1.37f, 0.61f));
  measure(state, double{kTarget} * kTarget * kReads, "fetch", [&] {
    if (compute) {
      target.bindImage(0, ImageAccess::Write);
      dispatchOver(program, kTarget, kTarget);
    } else {
      drawFullScreen(program, framebuffer);
    }
  });
}

// 7 x 7 box mean over 1024 x 1024 texels, three ways.
constexpr int kBox = 1024;

void boxShared(benchmark::State& state, int local_x, int local_y) {
  const ShaderFile file{"box_shared.comp", shaders::bench_gl::box_shared_comp};
  const std::vector<Define> list{{"LOCAL_X", std::to_string(local_x)}, {"LOCAL_Y", std::to_string(local_y)}};
  Program program = need(Program::compute(context(), {&file, 1}, list));
  const Texture target = need(Texture::create(context(), {Format::R32F, kBox, kBox}));
  program.setTexture("source", 1, source(Format::R8, 0));
  target.bindImage(0, ImageAccess::Write);
  measure(state, double{kBox} * kBox, "texel", [&] { dispatchOver(program, kBox, kBox); });
}

void boxPasses(benchmark::State& state, Format between) {
  const ShaderFile file{"box_pass.frag", shaders::bench_gl::box_pass_frag};
  Program program = need(Program::fullScreen(context(), {&file, 1}));
  const Texture middle = need(Texture::create(context(), {between, kBox, kBox}));
  const Texture target = need(Texture::create(context(), {Format::R32F, kBox, kBox}));
  Framebuffer first = need(Framebuffer::create(context(), middle));
  Framebuffer second = need(Framebuffer::create(context(), target));
  measure(state, double{kBox} * kBox, "texel", [&] {
    program.set("step_by", Eigen::Vector2i(1, 0));
    program.setTexture("source", 1, source(Format::R8, 0));
    drawFullScreen(program, first);
    program.set("step_by", Eigen::Vector2i(0, 1));
    program.setTexture("source", 1, middle);
    drawFullScreen(program, second);
  });
}

void boxDirect(benchmark::State& state) {
  const ShaderFile file{"box_direct.frag", shaders::bench_gl::box_direct_frag};
  Program program = need(Program::fullScreen(context(), {&file, 1}));
  const Texture target = need(Texture::create(context(), {Format::R32F, kBox, kBox}));
  Framebuffer framebuffer = need(Framebuffer::create(context(), target));
  program.setTexture("source", 1, source(Format::R8, 0));
  measure(state, double{kBox} * kBox, "texel", [&] { drawFullScreen(program, framebuffer); });
}

#define FETCH(name, ...) \
  BENCHMARK_CAPTURE(fetch, name, Case{__VA_ARGS__})->Unit(benchmark::kMillisecond)->UseRealTime()
FETCH(fragment_r8_sample, Sample, Format::R8);
FETCH(fragment_r8_sample_array, Sample, Format::R8, 0, 0, 2);
FETCH(fragment_r8_sample_level1, Level, Format::R8);
FETCH(fragment_r8_gather, Gather, Format::R8);
FETCH(fragment_r8_texel, Texel, Format::R8);
FETCH(fragment_r8_storage, Storage, Format::R8);
FETCH(fragment_r8_nearest, Nearest, Format::R8);
FETCH(fragment_rgba8_sample, Sample, Format::RGBA8);
FETCH(fragment_rgba8_sample_array, Sample, Format::RGBA8, 0, 0, 2);
FETCH(fragment_rgba8_gather, Gather, Format::RGBA8);
FETCH(fragment_rgba8_texel, Texel, Format::RGBA8);
FETCH(fragment_r16f_sample, Sample, Format::R16F);
FETCH(fragment_rgba8_nearest, Nearest, Format::RGBA8);
FETCH(fragment_rgba8_quad, Quad, Format::RGBA8);
FETCH(fragment_r32ui_quad, QuadWord, Format::R32UI);
FETCH(fragment_storage_quad, QuadStorage, Format::R32UI);
FETCH(fragment_r32f_gather, Gather, Format::R32F);
FETCH(fragment_r32f_texel, Texel, Format::R32F);
FETCH(fragment_r32f_sample, Sample, Format::R32F);
FETCH(fragment_rgba16f_sample, Sample, Format::RGBA16F);
FETCH(compute_8x8_r8_sample, Sample, Format::R8, 8, 8);
FETCH(compute_8x8_r8_sample_array, Sample, Format::R8, 8, 8, 2);
FETCH(compute_8x8_r8_gather, Gather, Format::R8, 8, 8);
FETCH(compute_8x8_r8_texel, Texel, Format::R8, 8, 8);
FETCH(compute_8x8_r8_storage, Storage, Format::R8, 8, 8);
FETCH(compute_8x8_r8_nearest, Nearest, Format::R8, 8, 8);
FETCH(compute_8x8_rgba8_sample, Sample, Format::RGBA8, 8, 8);
FETCH(compute_8x8_rgba8_gather, Gather, Format::RGBA8, 8, 8);
FETCH(compute_8x8_rgba8_nearest, Nearest, Format::RGBA8, 8, 8);
FETCH(compute_8x8_rgba8_quad, Quad, Format::RGBA8, 8, 8);
FETCH(compute_8x8_r32ui_quad, QuadWord, Format::R32UI, 8, 8);
FETCH(compute_8x8_storage_quad, QuadStorage, Format::R32UI, 8, 8);
FETCH(compute_8x8_r32f_gather, Gather, Format::R32F, 8, 8);
FETCH(compute_8x8_r32f_texel, Texel, Format::R32F, 8, 8);
FETCH(compute_8x8_r32f_sample, Sample, Format::R32F, 8, 8);
FETCH(compute_8x1_r8_sample, Sample, Format::R8, 8, 1);
FETCH(compute_16x8_r8_sample, Sample, Format::R8, 16, 8);
FETCH(compute_32x1_r8_sample, Sample, Format::R8, 32, 1);
FETCH(compute_32x4_r8_sample, Sample, Format::R8, 32, 4);
FETCH(compute_128x1_r8_sample, Sample, Format::R8, 128, 1);
BENCHMARK_CAPTURE(boxShared, 8x8, 8, 8)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(boxShared, 16x8, 16, 8)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(boxShared, 32x4, 32, 4)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(boxPasses, between_r8, Format::R8)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(boxPasses, between_r32f, Format::R32F)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(boxDirect)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace overfly::gl
