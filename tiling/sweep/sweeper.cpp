#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <tuple>
#include <utility>

#include "render/gl/commands.h"
#include "render/gl/framebuffer.h"
#include "render/gl/program.h"
#include "sweep_shaders.h"
#include "tiling/sweep/detail/view_geometry.h"
#include "tiling/sweep/height_filter.h"
#include "tiling/sweep/path_aggregation.h"
#include "tiling/sweep/sweep.h"

namespace overfly::tiling {
namespace {

constexpr int kPlanes = 7;
constexpr int kCentre = 3;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr const char* kHalfFloatScale = "16.0";

// What one pass gives per texel, see window_best.frag.
struct Best {
  float height, score, plane, strength;
};

// The textures of one grid size, kept from tile to tile.
struct Planes {
  gl::Texture base, a0, a1, b0, b1, best;
  gl::Framebuffer into_a, into_b, into_best;
};

gl::Sampling nearest() { return {gl::Filter::Nearest, gl::Filter::Nearest}; }

std::optional<std::string> problemOf(std::span<const SweepView> views, const SweepGrid& grid,
                                     const geo::LocalFrame& local) {
  if (views.size() < 2) return "fewer than two views see the cell";
  if (!(grid.max_height_m > grid.min_height_m)) return "the height range is empty";
  double widest = 0;
  for (const SweepView& view : views) {
    const capture::Pose& pose = view.pose;
    if (!pose.position_in_ecef.allFinite() || !pose.ecef_from_camera.coeffs().allFinite() ||
        std::abs(pose.ecef_from_camera.norm() - 1) > 1e-3)
      return "a pose is not finite";
    if (local.enuFromEcef(pose.position_in_ecef).z() <= grid.min_height_m)
      return "a camera is below the lowest plane";
    for (const SweepView& other : views)
      widest = std::max(widest, (pose.position_in_ecef - other.pose.position_in_ecef).norm());
  }
  const double depth = local.enuFromEcef(views[0].pose.position_in_ecef).z() - grid.min_height_m;
  if (widest < 1e-3 * depth) return "the views have no baseline";
  return std::nullopt;
}

}  // namespace

struct Sweeper::Impl {
  using CostKey = std::tuple<int, int>;             // cost, views
  using WindowKey = std::tuple<int, int>;           // radius, cost
  using FullKey = std::tuple<int, int, int, bool>;  // cost, views, levels, better half
  gl::Context* context = nullptr;
  std::map<CostKey, gl::Program> cost_programs;
  std::map<WindowKey, gl::Program> row_programs, best_programs, raw_programs;
  std::map<FullKey, gl::Program> full_programs;
  std::map<int, Planes> planes;

  Result<gl::Program*> costProgram(MatchCost cost, int views);
  Result<gl::Program*> windowProgram(std::map<WindowKey, gl::Program>& programs, const gl::ShaderFile& file,
                                     int radius, MatchCost cost, bool raw);
  Result<Planes*> planesOf(int side);
  struct Pass {
    const SweepGrid* grid;
    std::span<const SweepView> views;
    const SweepOptions* options;
    const ViewGeometry* geometry;
    int level;
    double plane_step_m;
    double lod;
  };
  // Costs of seven planes around base + offset, summed over the window; `raw`: the sums, else the best.
  Result<void> windowSums(const Pass& pass, Planes& planes, std::span<const float> base, double offset_m);
  Result<std::vector<Best>> bestOf(const Pass& pass, std::span<const float> base, double offset_m);
  Result<std::vector<Best>> sweepRange(const Pass& pass, HeightField& field);
  Result<std::vector<Best>> sweepBand(const Pass& pass, std::span<const float> coarse, HeightField& field);
};

Sweeper::Sweeper(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Sweeper::~Sweeper() = default;

Result<std::unique_ptr<Sweeper>> Sweeper::create(gl::Context& context) {
  auto impl = std::make_unique<Impl>();
  impl->context = &context;
  return std::unique_ptr<Sweeper>(new Sweeper(std::move(impl)));
}

Result<gl::Program*> Sweeper::Impl::costProgram(MatchCost cost, int views) {
  const CostKey key{static_cast<int>(cost), views};
  if (const auto found = cost_programs.find(key); found != cost_programs.end()) return &found->second;
  const std::array files{gl::ShaderFile{"texel_rays.glsl", shaders::sweep::texel_rays_glsl},
                         gl::ShaderFile{"plane_costs.frag", shaders::sweep::plane_costs_frag}};
  const std::array defines{gl::Define{"VIEWS", std::to_string(views)},
                           gl::Define{"COST", std::to_string(static_cast<int>(cost))},
                           // A plane that fewer than two views see: worse than no agreement.
                           gl::Define{"NO_VIEWS", cost == MatchCost::Zncc ? "-0.02" : "-1.0"},
                           gl::Define{"HALF_FLOAT_SCALE", kHalfFloatScale}};
  auto program = gl::Program::fullScreen(*context, files, defines);
  if (!program) return tl::unexpected(program.error());
  return &cost_programs.emplace(key, std::move(*program)).first->second;
}

Result<gl::Program*> Sweeper::Impl::windowProgram(std::map<WindowKey, gl::Program>& programs,
                                                  const gl::ShaderFile& file, int radius, MatchCost cost,
                                                  bool raw) {
  const WindowKey key{radius, static_cast<int>(cost)};
  if (const auto found = programs.find(key); found != programs.end()) return &found->second;
  std::vector<gl::Define> defines{{"RADIUS", std::to_string(radius)},
                                  {"COST", std::to_string(static_cast<int>(cost))},
                                  {"HALF_FLOAT_SCALE", kHalfFloatScale}};
  if (raw) defines.push_back({"RAW", "1"});
  auto program = gl::Program::fullScreen(*context, std::span(&file, 1), defines);
  if (!program) return tl::unexpected(program.error());
  return &programs.emplace(key, std::move(*program)).first->second;
}

Result<Planes*> Sweeper::Impl::planesOf(int side) {
  if (const auto found = planes.find(side); found != planes.end()) return &found->second;
  Planes made;
  const auto texture = [&](gl::Texture& into, gl::Format format) -> Result<void> {
    auto created = gl::Texture::create(
        *context, {.format = format, .width = side, .height = side, .sampling = nearest()});
    if (!created) return tl::unexpected(created.error());
    into = std::move(*created);
    return {};
  };
  for (const auto& [into, format] :
       {std::pair{&made.base, gl::Format::R32F}, std::pair{&made.a0, gl::Format::RGBA16F},
        std::pair{&made.a1, gl::Format::RGBA16F}, std::pair{&made.b0, gl::Format::RGBA16F},
        std::pair{&made.b1, gl::Format::RGBA16F}, std::pair{&made.best, gl::Format::RGBA32F}})
    if (auto ok = texture(*into, format); !ok) return tl::unexpected(ok.error());
  Planes& kept = planes.emplace(side, std::move(made)).first->second;
  const auto target = [&](gl::Framebuffer& into,
                          std::initializer_list<const gl::Texture*> textures) -> Result<void> {
    std::vector<gl::Attachment> attachments;
    for (const gl::Texture* t : textures) attachments.push_back({t, 0, 0});
    auto created = gl::Framebuffer::create(*context, attachments);
    if (!created) return tl::unexpected(created.error());
    into = std::move(*created);
    return {};
  };
  if (auto ok = target(kept.into_a, {&kept.a0, &kept.a1}); !ok) return tl::unexpected(ok.error());
  if (auto ok = target(kept.into_b, {&kept.b0, &kept.b1}); !ok) return tl::unexpected(ok.error());
  if (auto ok = target(kept.into_best, {&kept.best}); !ok) return tl::unexpected(ok.error());
  return &kept;
}

Result<void> Sweeper::Impl::windowSums(const Pass& pass, Planes& p, std::span<const float> base,
                                       double offset_m) {
  auto cost = costProgram(pass.options->cost, static_cast<int>(pass.views.size()));
  if (!cost) return tl::unexpected(cost.error());
  auto rows = windowProgram(row_programs, {"window_rows.frag", shaders::sweep::window_rows_frag},
                            pass.options->window_radius, pass.options->cost, false);
  if (!rows) return tl::unexpected(rows.error());
  p.base.upload(base);
  setRays(**cost, *pass.geometry, pass.views, pass.grid->texels >> pass.level, pass.grid->apron);
  (*cost)->setTexture("base_height", 0, p.base);
  (*cost)->set("plane_step", static_cast<float>(pass.plane_step_m));
  (*cost)->set("height_offset", static_cast<float>(offset_m));
  (*cost)->set("lod", static_cast<float>(pass.lod));
  gl::drawFullScreen(**cost, p.into_a);
  (*rows)->setTexture("first_in", 0, p.a0);
  (*rows)->setTexture("second_in", 1, p.a1);
  gl::drawFullScreen(**rows, p.into_b);
  return {};
}

Result<std::vector<Best>> Sweeper::Impl::bestOf(const Pass& pass, std::span<const float> base,
                                                double offset_m) {
  const int side = (pass.grid->texels >> pass.level) + 2 * pass.grid->apron;
  auto p = planesOf(side);
  if (!p) return tl::unexpected(p.error());
  if (auto ok = windowSums(pass, **p, base, offset_m); !ok) return tl::unexpected(ok.error());
  auto best = windowProgram(best_programs, {"window_best.frag", shaders::sweep::window_best_frag},
                            pass.options->window_radius, pass.options->cost, false);
  if (!best) return tl::unexpected(best.error());
  (*best)->setTexture("first_in", 0, (*p)->b0);
  (*best)->setTexture("second_in", 1, (*p)->b1);
  (*best)->setTexture("base_height", 2, (*p)->base);
  (*best)->set("plane_step", static_cast<float>(pass.plane_step_m));
  (*best)->set("height_offset", static_cast<float>(offset_m));
  gl::drawFullScreen(**best, (*p)->into_best);
  std::vector<Best> result(base.size());
  const std::span<float> floats(reinterpret_cast<float*>(result.data()), result.size() * 4);
  if (auto ok = (*p)->best.download(floats); !ok) return tl::unexpected(ok.error());
  return result;
}

// The whole range on the coarsest grid, seven planes at a time; runs overlap by two planes, so that every
// plane has both neighbours for the parabola.
Result<std::vector<Best>> Sweeper::Impl::sweepRange(const Pass& pass, HeightField& field) {
  const int side = (pass.grid->texels >> pass.level) + 2 * pass.grid->apron;
  const std::vector<float> flat(static_cast<std::size_t>(side) * static_cast<std::size_t>(side), 0.0f);
  const double range = pass.grid->max_height_m - pass.grid->min_height_m;
  const int planes_needed = static_cast<int>(std::ceil(range / pass.plane_step_m)) + 1;
  const int runs = std::max(1, (planes_needed - 2 + kPlanes - 3) / (kPlanes - 2));
  if (pass.options->regularise) {
    PlaneVolume volume(side, runs * (kPlanes - 2) + 2);
    for (int run = 0; run < runs; ++run) {
      auto p = planesOf(side);
      if (!p) return tl::unexpected(p.error());
      if (auto ok = windowSums(pass, **p, flat, pass.plane_step_m * (run * (kPlanes - 2) + kCentre)); !ok)
        return tl::unexpected(ok.error());
      auto raw = windowProgram(raw_programs, {"window_best.frag", shaders::sweep::window_best_frag},
                               pass.options->window_radius, pass.options->cost, true);
      if (!raw) return tl::unexpected(raw.error());
      (*raw)->setTexture("first_in", 0, (*p)->b0);
      (*raw)->setTexture("second_in", 1, (*p)->b1);
      gl::drawFullScreen(**raw, (*p)->into_a);
      std::vector<float> first(flat.size() * 4), second(flat.size() * 4);
      if (auto ok = (*p)->a0.download(std::span<float>(first)); !ok) return tl::unexpected(ok.error());
      if (auto ok = (*p)->a1.download(std::span<float>(second)); !ok) return tl::unexpected(ok.error());
      for (std::size_t i = 0; i < flat.size(); ++i) {
        const float normalise =
            pass.options->cost == MatchCost::Zncc ? 1.0f / std::max(second[4 * i + 3], 1e-5f) : 1.0f;
        for (int j = 0; j < kPlanes; ++j)
          volume.at(i, run * (kPlanes - 2) + j) =
              normalise * (j < 4 ? first[4 * i + static_cast<std::size_t>(j)]
                                 : second[4 * i + static_cast<std::size_t>(j - 4)]);
      }
    }
    field.samples += static_cast<std::uint64_t>(runs) * flat.size() * kPlanes * pass.views.size();
    const std::vector<PlaneVolume::Choice> choice =
        volume.aggregate(static_cast<float>(pass.options->path_penalty_step),
                         static_cast<float>(pass.options->path_penalty_jump));
    std::vector<Best> best(flat.size());
    for (std::size_t i = 0; i < flat.size(); ++i)
      best[i] = {static_cast<float>(pass.plane_step_m) * choice[i].plane, choice[i].score, kCentre, 1.0f};
    return best;
  }
  const auto interior = [](const Best& b) { return b.plane > 0.5f && b.plane < 5.5f; };
  std::vector<Best> best;
  for (int run = 0; run < runs; ++run) {
    auto found = bestOf(pass, flat, pass.plane_step_m * (run * (kPlanes - 2) + kCentre));
    if (!found) return found;
    field.samples += flat.size() * kPlanes * pass.views.size();
    if (best.empty()) {
      best = std::move(*found);
      continue;
    }
    for (std::size_t i = 0; i < best.size(); ++i) {
      // The agreement counts, not the score: each run divides by the strength at its own middle plane. Of two
      // runs that found the same plane, the one that has both its neighbours gives the parabola.
      const Best &b = (*found)[i], &a = best[i];
      const bool same = std::abs(b.height - a.height) < static_cast<float>(pass.plane_step_m);
      const bool better = b.score * b.strength > a.score * a.strength;
      if (same && interior(b) != interior(a) ? interior(b) : better) best[i] = b;
    }
  }
  for (Best& b : best) b.plane = kCentre;
  return best;
}

Result<std::vector<Best>> Sweeper::Impl::sweepBand(const Pass& pass, std::span<const float> coarse,
                                                   HeightField& field) {
  const int coarse_texels = pass.grid->texels >> (pass.level + 1);
  const int apron = pass.grid->apron;
  const std::vector<float> base = upsampleHeights(coarse, coarse_texels, apron);
  const auto count = [&] { field.samples += base.size() * kPlanes * pass.views.size(); };
  auto best = bestOf(pass, base, 0);
  if (!best) return best;
  count();
  const auto merge = [&](const std::vector<Best>& other, float margin, auto&& where) {
    for (std::size_t i = 0; i < best->size(); ++i)
      if (where(i) && other[i].score > (*best)[i].score + margin) (*best)[i] = other[i];
  };
  const auto fewTexels = static_cast<long>(base.size() / 1000);

  if (pass.options->two_surfaces) {
    const HeightBounds bounds = upsampleBounds(coarse, coarse_texels, apron);
    const auto isStep = [&](std::size_t i) {
      return bounds.high[i] - bounds.low[i] > 4.0f * static_cast<float>(pass.plane_step_m);
    };
    long steps = 0;
    for (std::size_t i = 0; i < base.size(); ++i) steps += isStep(i) ? 1 : 0;
    if (steps > fewTexels)
      for (const std::vector<float>* surface : {&bounds.low, &bounds.high}) {
        auto other = bestOf(pass, *surface, 0);
        if (!other) return other;
        count();
        merge(*other, 0.02f, isStep);
      }
  }
  for (int widening = 0; widening < pass.options->widenings; ++widening) {
    const auto atEdge = [&](std::size_t i) {
      const Best& b = (*best)[i];
      return (b.plane < 0.5f || b.plane > 5.5f) && b.score > 0;
    };
    long edges = 0;
    for (std::size_t i = 0; i < base.size(); ++i) edges += atEdge(i) ? 1 : 0;
    if (edges <= 10 * fewTexels) break;
    std::vector<float> moved(base.size());
    for (std::size_t i = 0; i < base.size(); ++i) moved[i] = (*best)[i].height;
    const int side = (pass.grid->texels >> pass.level) + 2 * apron;
    auto other = bestOf(pass, medianHeights(moved, side, 2), 0);
    if (!other) return other;
    count();
    merge(*other, 0.0f, atEdge);
  }
  return best;
}

Result<HeightField> Sweeper::run(const SweepGrid& grid, std::span<const SweepView> all_views,
                                 const SweepOptions& options) {
  HeightField field;
  field.texels = grid.texels;
  field.apron = grid.apron;
  const std::size_t count = static_cast<std::size_t>(field.side()) * static_cast<std::size_t>(field.side());
  const auto views = all_views.first(std::min<std::size_t>(
      all_views.size(), static_cast<std::size_t>(std::clamp(options.max_views, 2, SweepOptions::kMaxViews))));
  if (const auto problem = problemOf(views, grid, grid.frame->local())) {
    field.reason = *problem;
    field.height.assign(count, kNaN);
    field.score.assign(count, 0.0f);
    field.confidence.assign(count, 0);
    return field;
  }
  const ViewGeometry geometry = viewGeometry(views, *grid.frame, grid.ground_height_m, grid.min_height_m);
  const double texel_m = 2.0 * geometry.ground[1].norm() / grid.texels;

  std::vector<float> height;
  std::vector<Best> best;
  int levels = std::max(1, options.levels);
  while (levels > 1 && (grid.texels >> (levels - 1)) < 16) --levels;
  for (int level = levels - 1; level >= 0; --level) {
    const double spacing = texel_m * (1 << level);
    const Impl::Pass pass{&grid, views, &options, &geometry, level,
                          options.plane_step * spacing * geometry.height_per_baseline,
                          // The mip level whose pixels are nearest to the grid's spacing; a set's views
                          // differ little in GSD.
                          std::max(0.0, std::round(std::log2(spacing / geometry.gsd_m)))};
    auto found = level == levels - 1 ? impl_->sweepRange(pass, field) : impl_->sweepBand(pass, height, field);
    if (!found) return tl::unexpected(found.error());
    best = std::move(*found);
    std::vector<float> score(best.size());
    height.resize(best.size());
    for (std::size_t i = 0; i < best.size(); ++i) {
      height[i] = best[i].height;
      score[i] = best[i].score;
    }
    const int side = (grid.texels >> level) + 2 * grid.apron;
    height = medianHeights(height, side, options.median_radius);
    if (options.smooth_planes > 0)
      height = smoothHeights(height, score, side, options.smooth_planes * pass.plane_step_m);
    field.plane_step_m = pass.plane_step_m;
  }

  field.height = std::move(height);
  field.score.resize(count);
  field.confidence.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const float score = best[i].score;
    field.score[i] = score;
    const bool good = score >= static_cast<float>(options.min_score);
    field.height[i] = good ? field.height[i] + static_cast<float>(geometry.reference_height_m) : kNaN;
  }
  removeIslands(field.height, field.side(), 2.5 * field.plane_step_m, options.min_segment);
  for (std::size_t i = 0; i < count; ++i)
    field.confidence[i] = std::isnan(field.height[i])
                              ? std::uint8_t{0}
                              : static_cast<std::uint8_t>(std::clamp(255.0f * field.score[i], 1.0f, 255.0f));
  return field;
}

Result<HeightField> Sweeper::runFull(const SweepGrid& grid, std::span<const SweepView> all_views,
                                     const FullOptions& options) {
  HeightField field;
  field.texels = grid.texels;
  field.apron = grid.apron;
  const std::size_t count = static_cast<std::size_t>(field.side()) * static_cast<std::size_t>(field.side());
  const auto views = all_views.first(std::min<std::size_t>(all_views.size(), SweepOptions::kMaxViews));
  field.height.assign(count, kNaN);
  field.score.assign(count, 0.0f);
  field.confidence.assign(count, 0);
  if (const auto problem = problemOf(views, grid, grid.frame->local())) {
    field.reason = *problem;
    return field;
  }
  const ViewGeometry geometry = viewGeometry(views, *grid.frame, grid.ground_height_m, grid.min_height_m);
  const Impl::FullKey key{static_cast<int>(options.cost), static_cast<int>(views.size()),
                          options.window_levels, options.better_half};
  auto found = impl_->full_programs.find(key);
  if (found == impl_->full_programs.end()) {
    const std::array files{gl::ShaderFile{"texel_rays.glsl", shaders::sweep::texel_rays_glsl},
                           gl::ShaderFile{"full_sweep.frag", shaders::sweep::full_sweep_frag}};
    std::vector<gl::Define> defines{{"VIEWS", std::to_string(views.size())},
                                    {"COST", std::to_string(static_cast<int>(options.cost))},
                                    {"LEVELS", std::to_string(options.window_levels)}};
    if (options.better_half) defines.push_back({"BETTER_HALF", "1"});
    auto program = gl::Program::fullScreen(*impl_->context, files, defines);
    if (!program) return tl::unexpected(program.error());
    found = impl_->full_programs.emplace(key, std::move(*program)).first;
  }
  auto planes = impl_->planesOf(field.side());
  if (!planes) return tl::unexpected(planes.error());
  const int plane_count =
      static_cast<int>(std::ceil((grid.max_height_m - grid.min_height_m) / options.plane_step_m)) +
      1;  // (5.4)
  gl::Program& program = found->second;
  setRays(program, geometry, views, grid.texels, grid.apron);
  program.set("lowest_plane", 0.0f);
  program.set("plane_step", static_cast<float>(options.plane_step_m));
  program.set("planes", plane_count);
  program.set("first_lod", 0.0f);
  gl::drawFullScreen(program, (*planes)->into_best);
  std::vector<float> best(count * 4);
  if (auto ok = (*planes)->best.download(std::span<float>(best)); !ok) return tl::unexpected(ok.error());
  for (std::size_t i = 0; i < count; ++i) {
    if (best[4 * i + 2] < 2) continue;
    field.height[i] = best[4 * i] + static_cast<float>(geometry.reference_height_m);
    field.score[i] = -best[4 * i + 1];
    // A cost that several planes share tells nothing about which is right (5.5.1).
    field.confidence[i] = static_cast<std::uint8_t>(
        std::clamp(255.0f * (1.0f - best[4 * i + 1]) / std::max(best[4 * i + 3], 1.0f), 1.0f, 255.0f));
  }
  field.plane_step_m = options.plane_step_m;
  field.samples = count * static_cast<std::uint64_t>(plane_count) * views.size() *
                  static_cast<std::uint64_t>(options.window_levels);
  return field;
}

}  // namespace overfly::tiling
