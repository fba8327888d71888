#include "tiling/sweep/detail/sweep_passes.h"

#include <algorithm>
#include <array>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>

#include "render/gl/commands.h"
#include "sweep_shaders.h"

namespace overfly::tiling::detail {
namespace {

constexpr const char* kHalfFloatScale = "16.0";

gl::Sampling nearest() { return {gl::Filter::Nearest, gl::Filter::Nearest}; }

}  // namespace

Result<gl::Program*> SweepPasses::costProgram(const CostKey& key) {
  if (const auto found = cost_programs_.find(key); found != cost_programs_.end()) return &found->second;
  const auto [cost, views, better_half, masked, occluders] = key;
  const std::array files{gl::ShaderFile{"texel_rays.glsl", shaders::sweep::texel_rays_glsl},
                         gl::ShaderFile{"plane_costs.frag", shaders::sweep::plane_costs_frag}};
  std::vector<gl::Define> defines = viewDefines(views);
  defines.push_back({"COST", std::to_string(cost)});
  // A plane that fewer than two views see: worse than no agreement.
  defines.push_back({"NO_VIEWS", cost == static_cast<int>(MatchCost::Zncc) ? "-0.02" : "-1.0"});
  defines.push_back({"HALF_FLOAT_SCALE", kHalfFloatScale});
  if (better_half) defines.push_back({"BETTER_HALF", "1"});
  if (occluders) defines.push_back({"OCCLUDERS", "1"});
  auto program = masked ? TexelBlocks::program(*context_, files, defines)
                        : gl::Program::fullScreen(*context_, files, defines);
  if (!program) return tl::unexpected(program.error());
  return &cost_programs_.emplace(key, std::move(*program)).first->second;
}

Result<gl::Program*> SweepPasses::windowProgram(std::map<WindowKey, gl::Program>& programs,
                                                const gl::ShaderFile& file, const WindowKey& key) {
  if (const auto found = programs.find(key); found != programs.end()) return &found->second;
  const auto [radius, cost, raw, masked] = key;
  std::vector<gl::Define> defines{{"RADIUS", std::to_string(radius)},
                                  {"COST", std::to_string(cost)},
                                  {"HALF_FLOAT_SCALE", kHalfFloatScale}};
  if (raw) defines.push_back({"RAW", "1"});
  auto program = masked ? TexelBlocks::program(*context_, std::span(&file, 1), defines)
                        : gl::Program::fullScreen(*context_, std::span(&file, 1), defines);
  if (!program) return tl::unexpected(program.error());
  return &programs.emplace(key, std::move(*program)).first->second;
}

Result<SweepPasses::Targets*> SweepPasses::targetsOf(int side) {
  if (const auto found = targets_.find(side); found != targets_.end()) return &found->second;
  Targets made;
  for (const auto& [into, format] :
       {std::pair{&made.base, gl::Format::R32F}, std::pair{&made.surface, gl::Format::R32F},
        std::pair{&made.a0, gl::Format::RGBA16F}, std::pair{&made.a1, gl::Format::RGBA16F},
        std::pair{&made.b0, gl::Format::RGBA16F}, std::pair{&made.b1, gl::Format::RGBA16F},
        std::pair{&made.best, gl::Format::RGBA32F}, std::pair{&made.hidden, gl::Format::R32F}}) {
    auto created = gl::Texture::create(
        *context_, {.format = format, .width = side, .height = side, .sampling = nearest()});
    if (!created) return tl::unexpected(created.error());
    *into = std::move(*created);
  }
  auto wanted = TexelBlocks::create(*context_, side);
  if (!wanted) return tl::unexpected(wanted.error());
  made.wanted = std::move(*wanted);
  Targets& kept = targets_.emplace(side, std::move(made)).first->second;
  const auto target = [&](gl::Framebuffer& into,
                          std::initializer_list<const gl::Texture*> textures) -> Result<void> {
    std::vector<gl::Attachment> attachments;
    for (const gl::Texture* t : textures) attachments.push_back({t, 0, 0});
    auto created = gl::Framebuffer::create(*context_, attachments);
    if (!created) return tl::unexpected(created.error());
    into = std::move(*created);
    return {};
  };
  if (auto ok = target(kept.into_a, {&kept.a0, &kept.a1}); !ok) return tl::unexpected(ok.error());
  if (auto ok = target(kept.into_b, {&kept.b0, &kept.b1}); !ok) return tl::unexpected(ok.error());
  if (auto ok = target(kept.into_best, {&kept.best}); !ok) return tl::unexpected(ok.error());
  if (auto ok = target(kept.into_hidden, {&kept.hidden}); !ok) return tl::unexpected(ok.error());
  return &kept;
}

Result<bool> SweepPasses::findHidden(const Pass& pass, Targets& targets, double lowest_base_m,
                                     double offset_m, const Occluders& occluders) {
  // Less than the next coarser grid's plane step above the ray is within the error of its heights.
  const double clearance = 3 * pass.plane_step_m;
  const float highest = *std::max_element(occluders.height.begin(), occluders.height.end());
  if (static_cast<double>(highest) <= lowest_base_m + offset_m + clearance) return false;
  const int apron = pass.grid->apron, coarse_side = occluders.texels + 2 * apron;
  auto coarse = targetsOf(coarse_side);
  if (!coarse) return tl::unexpected(coarse.error());
  (*coarse)->surface.upload(occluders.height);
  const Occluder occluder{occluders.height, occluders.texels, apron, &(*coarse)->surface};
  const HiddenViews::Base base{&targets.base, offset_m, &targets.wanted};
  if (auto ok = hidden_.mark(*pass.geometry, pass.grid->texels >> pass.level, apron, occluder, &base,
                             {.rim = 2.0, .clearance_m = clearance}, targets.into_hidden);
      !ok)
    return tl::unexpected(ok.error());
  return true;
}

Result<SweepPasses::Targets*> SweepPasses::windowSums(const Pass& pass, std::span<const float> base,
                                                      double offset_m, std::uint64_t& samples,
                                                      std::span<const std::uint8_t> mask,
                                                      const Occluders* occluders) {
  if (pause_ && !pause_()) return fail(ErrorCode::Unavailable, "the sweep was put aside");
  const int side = pass.side(), radius = pass.options->window_radius;
  auto targets = targetsOf(side);
  if (!targets) return targets;
  Targets& p = **targets;
  const bool masked = !mask.empty();
  std::size_t texels = base.size();
  float lowest = *std::min_element(base.begin(), base.end());
  if (masked) {
    // The window needs its neighbours too.
    const cv::Mat wanted(side, side, CV_8U, const_cast<std::uint8_t*>(mask.data()));
    cv::Mat around;
    cv::dilate(wanted, around, cv::Mat::ones(2 * radius + 1, 2 * radius + 1, CV_8U));
    p.wanted.set({around.data, base.size()});
    texels = p.wanted.texels();
    lowest = std::numeric_limits<float>::max();
    for (std::size_t i = 0; i < base.size(); ++i)
      if (around.data[i] != 0) lowest = std::min(lowest, base[i]);
  }
  p.base.upload(base);
  const auto draw = [&](gl::Program& program, gl::Framebuffer& target) {
    if (masked)
      p.wanted.draw(program, target);
    else
      gl::drawFullScreen(program, target);
  };
  bool hidden = false;
  if (occluders != nullptr) {
    auto found = findHidden(pass, p, static_cast<double>(lowest), offset_m, *occluders);
    if (!found) return tl::unexpected(found.error());
    hidden = *found;
  }
  const int cost = static_cast<int>(pass.options->cost), views = static_cast<int>(pass.views.size());
  auto costs = costProgram({cost, views, pass.options->better_half, masked, hidden});
  if (!costs) return tl::unexpected(costs.error());
  auto rows = windowProgram(row_programs_, {"window_rows.frag", shaders::sweep::window_rows_frag},
                            {radius, cost, false, masked});
  if (!rows) return tl::unexpected(rows.error());
  setRays(**costs, *pass.geometry, pass.views, pass.grid->texels >> pass.level, pass.grid->apron);
  (*costs)->setTexture("base_height", 0, p.base);
  if (hidden) (*costs)->setTexture("hidden_views", views + 1, p.hidden);
  (*costs)->set("plane_step", static_cast<float>(pass.plane_step_m));
  (*costs)->set("height_offset", static_cast<float>(offset_m));
  (*costs)->set("lod", std::span<const float>(pass.lods));
  draw(**costs, p.into_a);
  (*rows)->setTexture("first_in", 0, p.a0);
  (*rows)->setTexture("second_in", 1, p.a1);
  draw(**rows, p.into_b);
  const std::uint64_t reads = pass.options->cost == MatchCost::Census ? 9 : 1;
  samples += texels * kPlanes * pass.views.size() * reads;
  return targets;
}

Result<std::vector<Best>> SweepPasses::best(const Pass& pass, std::span<const float> base, double offset_m,
                                            std::uint64_t& samples, std::span<const std::uint8_t> mask,
                                            const Occluders* occluders) {
  auto targets = windowSums(pass, base, offset_m, samples, mask, occluders);
  if (!targets) return tl::unexpected(targets.error());
  Targets& p = **targets;
  auto best = windowProgram(
      best_programs_, {"window_best.frag", shaders::sweep::window_best_frag},
      {pass.options->window_radius, static_cast<int>(pass.options->cost), false, !mask.empty()});
  if (!best) return tl::unexpected(best.error());
  (*best)->setTexture("first_in", 0, p.b0);
  (*best)->setTexture("second_in", 1, p.b1);
  (*best)->setTexture("base_height", 2, p.base);
  (*best)->set("plane_step", static_cast<float>(pass.plane_step_m));
  (*best)->set("height_offset", static_cast<float>(offset_m));
  if (mask.empty())
    gl::drawFullScreen(**best, p.into_best);
  else
    p.wanted.draw(**best, p.into_best);
  std::vector<Best> result(base.size());
  const std::span<float> floats(reinterpret_cast<float*>(result.data()), result.size() * 4);
  if (auto ok = p.best.download(floats); !ok) return tl::unexpected(ok.error());
  return result;
}

Result<std::vector<float>> SweepPasses::scores(const Pass& pass, std::span<const float> base, double offset_m,
                                               std::uint64_t& samples) {
  auto targets = windowSums(pass, base, offset_m, samples, {}, nullptr);
  if (!targets) return tl::unexpected(targets.error());
  Targets& p = **targets;
  auto raw = windowProgram(best_programs_, {"window_best.frag", shaders::sweep::window_best_frag},
                           {pass.options->window_radius, static_cast<int>(pass.options->cost), true, false});
  if (!raw) return tl::unexpected(raw.error());
  (*raw)->setTexture("first_in", 0, p.b0);
  (*raw)->setTexture("second_in", 1, p.b1);
  gl::drawFullScreen(**raw, p.into_a);
  std::vector<float> first(base.size() * 4), second(base.size() * 4), result(base.size() * kPlanes);
  if (auto ok = p.a0.download(std::span<float>(first)); !ok) return tl::unexpected(ok.error());
  if (auto ok = p.a1.download(std::span<float>(second)); !ok) return tl::unexpected(ok.error());
  for (std::size_t i = 0; i < base.size(); ++i) {
    const float normalise =
        pass.options->cost == MatchCost::Zncc ? 1.0f / std::max(second[4 * i + 3], 1e-5f) : 1.0f;
    for (std::size_t j = 0; j < kPlanes; ++j)
      result[i * kPlanes + j] = normalise * (j < 4 ? first[4 * i + j] : second[4 * i + j - 4]);
  }
  return result;
}

Result<std::vector<float>> SweepPasses::full(const SweepGrid& grid, std::span<const SweepView> views,
                                             const ViewGeometry& geometry,
                                             const Sweeper::FullOptions& options, int planes) {
  const FullKey key{static_cast<int>(options.cost), static_cast<int>(views.size()), options.window_levels,
                    options.better_half};
  auto found = full_programs_.find(key);
  if (found == full_programs_.end()) {
    const std::array files{gl::ShaderFile{"texel_rays.glsl", shaders::sweep::texel_rays_glsl},
                           gl::ShaderFile{"full_sweep.frag", shaders::sweep::full_sweep_frag}};
    std::vector<gl::Define> defines = viewDefines(static_cast<int>(views.size()));
    defines.push_back({"COST", std::to_string(static_cast<int>(options.cost))});
    defines.push_back({"LEVELS", std::to_string(options.window_levels)});
    if (options.better_half) defines.push_back({"BETTER_HALF", "1"});
    auto program = gl::Program::fullScreen(*context_, files, defines);
    if (!program) return tl::unexpected(program.error());
    found = full_programs_.emplace(key, std::move(*program)).first;
  }
  const int side = grid.texels + 2 * grid.apron;
  auto targets = targetsOf(side);
  if (!targets) return tl::unexpected(targets.error());
  gl::Program& program = found->second;
  setRays(program, geometry, views, grid.texels, grid.apron);
  program.set("lowest_plane", 0.0f);
  program.set("plane_step", static_cast<float>(options.plane_step_m));
  program.set("planes", planes);
  gl::drawFullScreen(program, (*targets)->into_best);
  std::vector<float> best(static_cast<std::size_t>(side) * static_cast<std::size_t>(side) * 4);
  if (auto ok = (*targets)->best.download(std::span<float>(best)); !ok) return tl::unexpected(ok.error());
  return best;
}

}  // namespace overfly::tiling::detail
