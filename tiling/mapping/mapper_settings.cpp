#include "tiling/mapping/mapper_settings.h"

#include <algorithm>

#include "capture/geo/geodetic.h"

namespace overfly::tiling {
namespace {

MatchCost costFrom(config::MatchingCost cost) {
  switch (cost) {
    case config::MatchingCost::Sad:
      return MatchCost::Sad;
    case config::MatchingCost::Ssd:
      return MatchCost::Ssd;
    case config::MatchingCost::Census:
      return MatchCost::Census;
    case config::MatchingCost::Zncc:
      break;
  }
  return MatchCost::Zncc;
}

RecencyOptions recencyFrom(const config::Sweep& settings) {
  RecencyOptions recency;
  switch (settings.prefer) {
    case config::Prefer::Best:
      recency.prefer = Prefer::Best;
      break;
    case config::Prefer::Latest:
      recency.prefer = Prefer::Latest;
      break;
    case config::Prefer::MaxAge:
      recency.prefer = Prefer::MaxAge;
      break;
  }
  recency.max_age_s = settings.max_age_s;
  return recency;
}

Fallback fallbackFrom(config::Fallback fallback) {
  switch (fallback) {
    case config::Fallback::Blend:
      return Fallback::Blend;
    case config::Fallback::Average:
      return Fallback::Average;
    case config::Fallback::Overwrite:
      return Fallback::Overwrite;
    case config::Fallback::LowestCost:
      return Fallback::LowestCost;
    case config::Fallback::ImageCentre:
      break;
  }
  return Fallback::ImageCentre;
}

}  // namespace

MapperOptions mapperOptions(const config::Settings& settings) {
  const config::Sweep& from = settings.sweep;
  MapperOptions options;
  SweepOptions& sweep = options.sweep;
  sweep.cost = costFrom(from.cost);
  sweep.max_views = from.images;
  sweep.window_radius = from.window / 2;
  sweep.levels = from.levels;
  sweep.max_planes = from.planes;
  sweep.better_half = from.better_half;
  // On real ground the search for rivals costs more heights than it saves from being wrong: caliterra kept
  // 0.945 of its strong points with it, against 0.985 that are asked for (docs/sweep.md).
  sweep.max_rival = 1;
  sweep.regularise = from.regularise > 0;
  if (sweep.regularise) {  // 0.5 is the sweep's own default
    sweep.path_penalty_step *= 2 * from.regularise;
    sweep.path_penalty_jump *= 2 * from.regularise;
  }
  sweep.min_score = from.min_confidence;
  ViewSelectionOptions& views = options.views;
  views.parallax_low = geo::radians(from.min_parallax_deg);
  views.parallax_high = geo::radians(from.max_parallax_deg);
  views.parallax_best_from = std::clamp(views.parallax_best_from, views.parallax_low, views.parallax_high);
  views.parallax_best_to = std::clamp(views.parallax_best_to, views.parallax_best_from, views.parallax_high);
  options.recency = recencyFrom(from);
  options.fallback = fallbackFrom(from.fallback);
  options.working_scale = from.working_scale;
  options.tile_size = settings.map.tile_size;
  options.hole_texels = from.fill ? options.hole_texels : 0;
  options.frame_cache_bytes = static_cast<std::size_t>(settings.gpu.frame_cache_mb) << 20;
  return options;
}

GroundOptions groundOptions(const config::Settings& settings) {
  GroundOptions options;
  options.tile_size = settings.map.tile_size;
  if (settings.map.gsd_m > 0) options.gsd_m = settings.map.gsd_m;
  options.search_above_m = settings.sweep.search_above_m;
  options.search_below_m = settings.sweep.search_below_m;
  return options;
}

}  // namespace overfly::tiling
