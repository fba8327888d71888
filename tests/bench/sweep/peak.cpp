#include <algorithm>
#include <array>
#include <cstdio>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "bench_gl_shaders.h"
#include "render/gl/commands.h"
#include "tests/bench/sweep/bench.h"
#include "tests/bench/sweep/site.h"

namespace overfly::bench {

using namespace overfly::tiling;

namespace {

constexpr int kSource = 2048, kTarget = 512, kReads = 32;

// Millions of bilinear reads a CPU second, the best of five.
double fetchRate(gl::Context& context, gl::Format format, bool gather, bool compute) {
  namespace files = shaders::bench_gl;
  std::mt19937 random(1);
  std::vector<std::uint8_t> texels(std::size_t{kSource} * kSource *
                                   static_cast<std::size_t>(gl::channels(format)));
  for (auto& texel : texels) texel = static_cast<std::uint8_t>(random());
  gl::Texture source = need(gl::Texture::create(context, {format, kSource, kSource}));
  source.upload(std::span<const std::uint8_t>(texels));
  const std::array list{gl::ShaderFile{"fetch.glsl", files::fetch_glsl},
                        compute ? gl::ShaderFile{"fetch.comp", files::fetch_comp}
                                : gl::ShaderFile{"fetch.frag", files::fetch_frag}};
  std::vector<gl::Define> defines{{"METHOD", gather ? "1" : "0"},
                                  {"READS", std::to_string(kReads)},
                                  {"VALUE", gather || gl::channels(format) == 1 ? "float" : "vec4"}};
  if (compute) {
    defines.push_back({"LOCAL_X", "8"});
    defines.push_back({"LOCAL_Y", "8"});
  }
  gl::Program program = need(compute ? gl::Program::compute(context, list, defines)
                                     : gl::Program::fullScreen(context, list, defines));
  const gl::Texture target = need(gl::Texture::create(context, {gl::Format::RGBA16F, kTarget, kTarget}));
  gl::Framebuffer framebuffer = need(gl::Framebuffer::create(context, target));
  program.setTexture("source", 1, source);
  program.set("inverse_size", Eigen::Vector2f(1.0f / kSource, 1.0f / kSource));
  program.set("along", Eigen::Vector2f(1.37f, 0.61f));
  double best = 0;
  for (int round = 0; round < 6; ++round) {
    const double begin = cpuSeconds();
    if (compute) {
      target.bindImage(0, gl::ImageAccess::Write);
      gl::dispatchOver(program, kTarget, kTarget);
    } else {
      gl::drawFullScreen(program, framebuffer);
    }
    context.finish();
    const double rate = double{kTarget} * kTarget * kReads / (cpuSeconds() - begin) * 1e-6;
    if (round > 0) best = std::max(best, rate);  // the first compiles
  }
  return best;
}

}  // namespace

void peak(gl::Context& context, const std::string& flight) {
  double best = 0;
  std::printf("bilinear reads, millions a CPU second:\n");
  for (const auto& [name, format, gather, compute] :
       {std::tuple{"R8 sampled, fragment", gl::Format::R8, false, false},
        std::tuple{"R8 gathered, fragment", gl::Format::R8, true, false},
        std::tuple{"RGBA8 sampled, fragment", gl::Format::RGBA8, false, false},
        std::tuple{"RGBA8 gathered, fragment", gl::Format::RGBA8, true, false},
        std::tuple{"R8 sampled, compute", gl::Format::R8, false, true},
        std::tuple{"R8 gathered, compute", gl::Format::R8, true, true},
        std::tuple{"RGBA8 sampled, compute", gl::Format::RGBA8, false, true},
        std::tuple{"RGBA8 gathered, compute", gl::Format::RGBA8, true, true}}) {
    const double rate = fetchRate(context, format, gather, compute);
    best = std::max(best, rate);
    std::printf("  %-26s %7.1f\n", name, rate);
  }
  std::printf("  peak                       %7.1f\n\n", best);

  const Site site(context, flight);
  const std::vector<Site::Cell> cells = site.cells(20, 8);
  if (cells.empty()) throw std::runtime_error("no cell is seen by eight frames");
  const Site::Cell& cell = cells[cells.size() / 2];
  const geo::TileFrame frame = site.frameOf(cell);
  const SweepGrid grid = site.grid(frame, 256);
  const auto sweeper = need(Sweeper::create(context));
  std::printf("full sweep, SAD, one texel:\n");
  for (const std::size_t n : {std::size_t{2}, std::size_t{4}, std::size_t{6}, std::size_t{8}}) {
    const Site::Views views = site.viewsOf(cell, n);
    double rate = 0;
    for (int round = 0; round < 4; ++round) {
      const double begin = cpuSeconds();
      const HeightField field = need(sweeper->runFull(grid, views.on_luma, {.plane_step_m = 0.2}));
      if (round > 0)
        rate = std::max(rate, static_cast<double>(field.samples) / (cpuSeconds() - begin) * 1e-6);
    }
    std::printf("  %zu images                   %7.1f  = %.0f %% of the peak\n", n, rate, 100 * rate / best);
  }
  // A tile's first sweep takes its frames to the GPU; a later one of the same frames does not.
  const Site::Views views = site.viewsOf(cell, 8);
  const RectifyTimes times = site.uploadTimes(cell, 8);
  const double begin = cpuSeconds();
  static_cast<void>(need(sweeper->run(grid, views.on_match, {})));
  std::printf(
      "\n8 frames to the GPU: decoding %.3f s, upload %.3f s, undistortion and mips %.3f s (wall); a sweep "
      "of 8: %.3f CPU s\n",
      times.decode_s, times.upload_s, times.gpu_s, cpuSeconds() - begin);
}

}  // namespace overfly::bench
