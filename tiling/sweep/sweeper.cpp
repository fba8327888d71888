#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "tiling/sweep/detail/rivals.h"
#include "tiling/sweep/detail/sweep_passes.h"
#include "tiling/sweep/detail/view_geometry.h"
#include "tiling/sweep/height_filter.h"
#include "tiling/sweep/path_aggregation.h"
#include "tiling/sweep/sweep.h"

namespace overfly::tiling {
namespace {

using detail::Best;
using detail::kCentre;
using detail::kPlanes;
using detail::Pass;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr double kLeastBaseline = 0.01;  // of two views, in depths

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
  // Below half a degree a tenth of a pixel is ten GSD of height: any height would be a guess.
  if (widest < kLeastBaseline * depth) return "the views have no baseline";
  return std::nullopt;
}

// The mip level whose pixels are nearest to the grid's spacing: one for all views whose resolution on the
// ground is about the same, so that they are equally sharp, another for those that differ by a level.
std::vector<float> mipLevels(const ViewGeometry& geometry, double spacing_m) {
  const double common = std::round(std::log2(spacing_m / geometry.gsd_m));
  std::vector<float> lods;
  for (const double gsd_m : geometry.view_gsd_m)
    lods.push_back(static_cast<float>(std::max(0.0, common + std::round(std::log2(geometry.gsd_m / gsd_m)))));
  return lods;
}

// The best over the whole range, and what comes next to it.
struct RangeSearch {
  std::vector<Best> best;
  std::vector<float> rival_height, rival_share;
};

// Leaves of the marked texels (1, others 0) those with more than half of their neighbourhood marked, and
// counts them. Where a surface runs out of the band its texels stand together; single ones are noise, which
// the median takes away.
std::size_t keepGroups(std::vector<std::uint8_t>& mask, int side) {
  const cv::Mat marked(side, side, CV_8U, mask.data());
  cv::Mat around;
  cv::boxFilter(marked, around, CV_8U, {3, 3}, {-1, -1}, false, cv::BORDER_CONSTANT);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    mask[i] = mask[i] != 0 && around.data[i] >= 5 ? 1 : 0;
    kept += mask[i];
  }
  return kept;
}

}  // namespace

struct Sweeper::Impl {
  explicit Impl(gl::Context& context) : passes(context) {}
  detail::SweepPasses passes;

  Result<RangeSearch> sweepRange(const Pass& pass, HeightField& field);
  Result<RangeSearch> sweepRangeRegularised(const Pass& pass, int runs, HeightField& field);
  Result<std::vector<Best>> sweepBand(const Pass& pass, std::span<const float> coarse, HeightField& field);
};

Sweeper::Sweeper(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Sweeper::~Sweeper() = default;

void Sweeper::onPause(std::function<bool()> pause) { impl_->passes.onPause(std::move(pause)); }

Result<std::unique_ptr<Sweeper>> Sweeper::create(gl::Context& context) {
  return std::unique_ptr<Sweeper>(new Sweeper(std::make_unique<Impl>(context)));
}

// The whole range on the coarsest grid, seven planes at a time; runs overlap by two planes, so that every
// plane has both neighbours for the parabola.
Result<RangeSearch> Sweeper::Impl::sweepRange(const Pass& pass, HeightField& field) {
  const std::vector<float> flat(pass.count(), 0.0f);
  const double range = pass.grid->max_height_m - pass.grid->min_height_m;
  const int planes_needed = static_cast<int>(std::ceil(range / pass.plane_step_m)) + 1;
  const int runs = std::max(1, (planes_needed - 2 + kPlanes - 3) / (kPlanes - 2));
  if (pass.options->regularise) return sweepRangeRegularised(pass, runs, field);
  const auto step = static_cast<float>(pass.plane_step_m);
  const auto interior = [](const Best& b) { return b.plane > 0.5f && b.plane < 5.5f; };
  RangeSearch search;
  std::vector<Best>& best = search.best;
  std::vector<float> rival(flat.size(), 0.0f);  // agreement
  search.rival_height.assign(flat.size(), kNaN);
  for (int run = 0; run < runs; ++run) {
    auto found = passes.best(pass, flat, pass.plane_step_m * (run * (kPlanes - 2) + kCentre), field.samples);
    if (!found) return tl::unexpected(found.error());
    if (best.empty()) {
      best = std::move(*found);
      continue;
    }
    for (std::size_t i = 0; i < best.size(); ++i) {
      // The agreement counts, not the score: each run divides by the strength at its own middle plane. Of two
      // runs that found the same plane, the one that has both its neighbours gives the parabola.
      const Best &b = (*found)[i], a = best[i];
      const float of_a = a.agreement(), of_b = b.agreement();
      const bool same = std::abs(b.height - a.height) < step;
      const bool takes = same && interior(b) != interior(a) ? interior(b) : of_b > of_a;
      if (takes) best[i] = b;
      const Best& other = takes ? a : b;
      if (std::abs(b.height - a.height) > 2.5f * step && std::min(of_a, of_b) > rival[i] && interior(other)) {
        rival[i] = std::min(of_a, of_b);
        search.rival_height[i] = other.height;
      }
    }
  }
  search.rival_share.resize(best.size());
  for (std::size_t i = 0; i < best.size(); ++i)
    search.rival_share[i] = rival[i] / std::max(best[i].agreement(), 1e-6f);
  for (Best& b : best) b.plane = kCentre;
  return search;
}

Result<RangeSearch> Sweeper::Impl::sweepRangeRegularised(const Pass& pass, int runs, HeightField& field) {
  const std::vector<float> flat(pass.count(), 0.0f);
  const int planes = runs * (kPlanes - 2) + 2;
  PlaneVolume volume(pass.side(), planes);
  for (int run = 0; run < runs; ++run) {
    auto scores =
        passes.scores(pass, flat, pass.plane_step_m * (run * (kPlanes - 2) + kCentre), field.samples);
    if (!scores) return tl::unexpected(scores.error());
    for (std::size_t i = 0; i < flat.size(); ++i)
      for (int j = 0; j < kPlanes; ++j)
        volume.at(i, run * (kPlanes - 2) + j) = (*scores)[i * kPlanes + static_cast<std::size_t>(j)];
  }
  const std::vector<PlaneVolume::Choice> choice =
      volume.aggregate(static_cast<float>(pass.options->path_penalty_step),
                       static_cast<float>(pass.options->path_penalty_jump));
  RangeSearch search;
  search.best.resize(flat.size());
  search.rival_height.assign(flat.size(), kNaN);
  search.rival_share.assign(flat.size(), 0.0f);
  const auto step = static_cast<float>(pass.plane_step_m);
  for (std::size_t i = 0; i < flat.size(); ++i) {
    search.best[i] = {step * choice[i].plane, choice[i].score, kCentre, 1.0f};
    for (int plane = 1; plane + 1 < planes; ++plane) {
      if (std::abs(static_cast<float>(plane) - choice[i].plane) < 3) continue;
      const float share = volume.at(i, plane) / std::max(choice[i].score, 1e-6f);
      if (share <= search.rival_share[i]) continue;
      search.rival_share[i] = share;
      search.rival_height[i] = step * static_cast<float>(plane);
    }
  }
  return search;
}

Result<std::vector<Best>> Sweeper::Impl::sweepBand(const Pass& pass, std::span<const float> coarse,
                                                   HeightField& field) {
  const int coarse_texels = pass.grid->texels >> (pass.level + 1);
  const int apron = pass.grid->apron;
  const std::vector<float> base = upsampleHeights(coarse, coarse_texels, apron);
  auto best = passes.best(pass, base, 0, field.samples);
  if (!best) return best;
  std::vector<std::uint8_t> mask(base.size());
  const auto mark = [&](auto&& where) {
    std::size_t marked = 0;
    for (std::size_t i = 0; i < mask.size(); ++i) {
      const bool wanted = where(i);
      mask[i] = wanted ? 1 : 0;
      marked += wanted ? 1 : 0;
    }
    return marked;
  };
  const auto merge = [&](const std::vector<Best>& other, float margin) {
    for (std::size_t i = 0; i < best->size(); ++i)
      if (mask[i] != 0 && other[i].agreement() > (*best)[i].agreement() + margin * (*best)[i].strength)
        (*best)[i] = other[i];
  };
  const std::size_t few_texels = base.size() / 1000;

  if (pass.options->two_surfaces) {
    const HeightBounds bounds = upsampleBounds(coarse, coarse_texels, apron);
    const std::size_t steps = mark([&](std::size_t i) {
      return bounds.high[i] - bounds.low[i] > 4.0f * static_cast<float>(pass.plane_step_m);
    });
    const detail::Occluders occluders{coarse, coarse_texels};
    if (steps > few_texels)
      for (const std::vector<float>* surface : {&bounds.low, &bounds.high}) {
        auto other = passes.best(pass, *surface, 0, field.samples, mask,
                                 pass.options->occlusion ? &occluders : nullptr);
        if (!other) return other;
        merge(*other, 0.02f);
      }
  }
  for (int widening = 0; widening < pass.options->widenings; ++widening) {
    mark([&](std::size_t i) {
      const Best& b = (*best)[i];
      return (b.plane < 0.5f || b.plane > 5.5f) && b.score > 0;
    });
    if (keepGroups(mask, pass.side()) <= 2 * few_texels) break;
    std::vector<float> moved(base.size());
    for (std::size_t i = 0; i < base.size(); ++i) moved[i] = (*best)[i].height;
    auto other = passes.best(pass, medianHeights(moved, pass.side(), 2), 0, field.samples, mask);
    if (!other) return other;
    merge(*other, 0.0f);
  }
  return best;
}

Result<HeightField> Sweeper::run(const SweepGrid& grid, std::span<const SweepView> all_views,
                                 const SweepOptions& options) {
  int levels = std::max(1, options.levels);
  while (levels > 1 && (grid.texels >> (levels - 1)) < 16) --levels;
  const int finest = std::clamp(options.finest_level, 0, levels - 1);
  HeightField field;
  field.texels = grid.texels >> finest;
  field.apron = grid.apron;
  field.halvings = finest;
  const auto views = all_views.first(std::min<std::size_t>(
      all_views.size(), static_cast<std::size_t>(std::clamp(options.max_views, 2, SweepOptions::kMaxViews))));
  if (const auto problem = problemOf(views, grid, grid.frame->local())) {
    field.reason = *problem;
    const auto count = static_cast<std::size_t>(field.side()) * static_cast<std::size_t>(field.side());
    field.height.assign(count, kNaN);
    field.score.assign(count, 0.0f);
    field.confidence.assign(count, 0);
    return field;
  }
  const ViewGeometry geometry = viewGeometry(views, *grid.frame, grid.ground_height_m, grid.min_height_m);
  const double texel_m = 2.0 * geometry.ground[1].norm() / grid.texels;

  std::vector<float> height;
  std::vector<Best> best;
  detail::Rivals rivals(options.max_rival);
  // Two or three views agree by chance as well as a pattern does.
  const bool asks_for_rivals = options.max_rival < 1 && views.size() >= 4;
  for (int level = levels - 1; level >= finest; --level) {
    const double spacing = texel_m * (1 << level);
    double plane_step_m = options.plane_step * spacing * geometry.height_per_baseline;
    if (level == levels - 1)
      plane_step_m = std::max(plane_step_m,
                              (grid.max_height_m - grid.min_height_m) / std::max(options.max_planes - 1, 1));
    const Pass pass{&grid, views, &options, &geometry, level, plane_step_m, mipLevels(geometry, spacing)};
    if (level == levels - 1) {
      auto found = impl_->sweepRange(pass, field);
      if (!found) return tl::unexpected(found.error());
      best = std::move(found->best);
      if (asks_for_rivals) rivals.begin(pass.side(), best, found->rival_height, found->rival_share);
    } else {
      auto found = impl_->sweepBand(pass, height, field);
      if (!found) return tl::unexpected(found.error());
      best = std::move(*found);
      if (asks_for_rivals)
        if (auto ok = rivals.refine(impl_->passes, pass, best, field.samples); !ok)
          return tl::unexpected(ok.error());
    }
    std::vector<float> score(best.size());
    height.resize(best.size());
    for (std::size_t i = 0; i < best.size(); ++i) {
      height[i] = best[i].height;
      score[i] = best[i].score;
    }
    height = medianHeights(height, pass.side(), options.median_radius);
    if (options.smooth_planes > 0)
      height = smoothHeights(height, score, pass.side(), options.smooth_planes * pass.plane_step_m);
    field.plane_step_m = pass.plane_step_m;
  }
  std::vector<std::uint8_t> repeats;
  if (asks_for_rivals) repeats = rivals.texels();

  const std::size_t count = best.size();
  field.height = std::move(height);
  field.score.resize(count);
  field.confidence.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const float score = best[i].score;
    field.score[i] = score;
    const bool good = score >= static_cast<float>(options.min_score);
    field.height[i] = good ? field.height[i] + static_cast<float>(geometry.reference_height_m) : kNaN;
  }
  for (std::size_t i = 0; i < repeats.size(); ++i)
    if (repeats[i] != 0) field.height[i] = kNaN;
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
  const int plane_count =
      static_cast<int>(std::ceil((grid.max_height_m - grid.min_height_m) / options.plane_step_m)) +
      1;  // (5.4)
  auto made = impl_->passes.full(grid, views, geometry, options, plane_count);
  if (!made) return tl::unexpected(made.error());
  const std::vector<float>& best = *made;
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
