#include "daemon/tradeoff/sweep_trials.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "tiling/mapping/mapper_settings.h"

namespace overfly::tradeoff {
namespace {

using tiling::MapperOptions;
using tiling::MatchCost;

class Grid {
 public:
  explicit Grid(const MapperOptions& defaults) : defaults_(defaults) {}
  template <typename Change>
  void add(const std::string& axis, const std::string& text, Change&& change) {
    SweepSetting setting{axis, text, false, defaults_, 0, {}};
    change(setting.options);
    settings_.push_back(std::move(setting));
  }
  void addPoint(daemon::OperatingPoint point, bool is_default) {
    SweepSetting setting{is_default ? "default" : "combined", point.name, is_default, defaults_, 0, point};
    setting.options.sweep = point.applied(setting.options.sweep);
    settings_.push_back(std::move(setting));
  }
  // Of a map `coarser` zooms above what the frames allow, or of frames reduced so many times.
  void addScaled(const std::string& scale, const daemon::OperatingPoint& point, int coarser, int reduce) {
    SweepSetting setting{"combined", scale + ", " + point.name, false, defaults_, coarser, {}, reduce};
    setting.options.sweep = point.applied(setting.options.sweep);
    settings_.push_back(std::move(setting));
  }
  std::vector<SweepSetting> take() { return std::move(settings_); }

 private:
  MapperOptions defaults_;
  std::vector<SweepSetting> settings_;
};

std::string nameOf(const daemon::OperatingPoint& p) {
  return fmt::format("images {}, window {}, grid 1/{}{}", p.images, 2 * p.window_radius + 1,
                     1 << p.finest_level, p.two_surfaces ? "" : ", one surface");
}

daemon::OperatingPoint pointOf(const tiling::SweepOptions& o) {
  daemon::OperatingPoint p;
  p.images = o.max_views;
  p.window_radius = o.window_radius;
  p.levels = o.levels;
  p.finest_level = o.finest_level;
  p.widenings = o.widenings;
  p.two_surfaces = o.two_surfaces;
  return p;
}

}  // namespace

std::vector<SweepSetting> sweepSettings(bool quick) {
  const MapperOptions defaults = tiling::mapperOptions({});  // what maps are made with
  Grid grid(defaults);
  daemon::OperatingPoint standard = pointOf(defaults.sweep);
  standard.name = nameOf(standard);
  standard.as_set = true;
  grid.addPoint(standard, true);
  const auto wanted = [&](int value, std::initializer_list<int> quick_values) {
    return !quick || std::find(quick_values.begin(), quick_values.end(), value) != quick_values.end();
  };
  for (const int images : {2, 3, 4, 6, 8, 10, 14})
    if (wanted(images, {4, 8}))
      grid.add("images", fmt::format("images {}", images),
               [&](MapperOptions& o) { o.sweep.max_views = images; });
  for (const int radius : {1, 2, 4, 5})
    if (wanted(radius, {2, 4}))
      grid.add("window", fmt::format("window {}", 2 * radius + 1),
               [&](MapperOptions& o) { o.sweep.window_radius = radius; });
  for (const auto& [cost, name] : {std::pair{MatchCost::Sad, "SAD"}, std::pair{MatchCost::Ssd, "SSD"},
                                   std::pair{MatchCost::Census, "census"}})
    if (wanted(static_cast<int>(cost), {static_cast<int>(MatchCost::Sad)}))
      grid.add("cost", fmt::format("cost {}", name),
               [cost = cost](MapperOptions& o) { o.sweep.cost = cost; });
  for (const double step : {0.4, 0.6, 1.2, 1.6})
    if (!quick || step == 0.4 || step == 1.6)
      grid.add("plane step", fmt::format("plane step {}", step),
               [&](MapperOptions& o) { o.sweep.plane_step = step; });
  for (const int levels : {2, 3, 5})
    if (wanted(levels, {3}))
      grid.add("levels", fmt::format("levels {}", levels),
               [&](MapperOptions& o) { o.sweep.levels = levels; });
  for (const int finest : {1, 2})
    if (wanted(finest, {1}))
      grid.add("finest grid", fmt::format("grid 1/{}", 1 << finest),
               [&](MapperOptions& o) { o.sweep.finest_level = finest; });
  grid.add("regularisation", "regularised", [](MapperOptions& o) { o.sweep.regularise = true; });
  grid.add("surfaces", "one surface at steps", [](MapperOptions& o) { o.sweep.two_surfaces = false; });
  if (!quick) {
    grid.add("band", "no widening", [](MapperOptions& o) { o.sweep.widenings = 0; });
    grid.add("filter", "no smoothing", [](MapperOptions& o) { o.sweep.smooth_planes = 0; });
    grid.add("filter", "no median", [](MapperOptions& o) { o.sweep.median_radius = 0; });
    grid.add("tile", "tiles of 512", [](MapperOptions& o) { o.tile_size = 512; });
  }
  grid.add("working resolution", "pictures at half resolution",
           [](MapperOptions& o) { o.working_scale = 0.5; });

  // From the fastest to the most accurate that the governor may choose.
  for (const int images : {2, 3, 4, 6, 8, standard.images})
    for (const int finest : {2, 1, 0})
      for (const bool thorough : {false, true}) {
        if (quick && (images == 3 || images == 6)) continue;
        daemon::OperatingPoint p = standard;
        p.as_set = false;
        p.images = images;
        p.finest_level = finest;
        p.two_surfaces = thorough;
        p.widenings = thorough ? standard.widenings : 0;
        if (finest == 2) p.window_radius = 2;
        if (finest == 2 && thorough) continue;  // dearer than the same without, and no better
        p.name = nameOf(p);
        if (p.name != standard.name) grid.addPoint(p, false);
      }
  // Coarser maps, and reduced frames: what a search from far above needs, and the fast end of the front.
  daemon::OperatingPoint middling = standard;
  middling.two_surfaces = false;
  middling.widenings = 0;
  middling.images = 8;
  daemon::OperatingPoint quickly = middling;
  middling.finest_level = 1;
  quickly.images = 4;
  for (daemon::OperatingPoint point : {standard, middling, quickly}) {
    point.name = nameOf(point);
    for (const int zooms : {1, 2})
      grid.addScaled(fmt::format("texels of {} GSD", 1 << zooms), point, zooms, 1);
    for (const int reduce : {2, 4, 8}) grid.addScaled(fmt::format("frames 1/{}", reduce), point, 0, reduce);
  }
  grid.add("combined", "plane step 0.4, regularised", [](MapperOptions& o) {
    o.sweep.plane_step = 0.4;
    o.sweep.regularise = true;
  });
  return grid.take();
}

Result<SweepTrials> trySweep(
    gl::Context& context, const FlightReference& reference, const std::vector<SweepSetting>& settings,
    int repeats, const std::function<void(std::size_t, std::size_t, const std::string&)>& progress) {
  SweepTrials result;
  double slowest_sweep = 0;
  std::optional<tiling::MapGround> native;
  const std::size_t total = settings.size();
  for (std::size_t i = 0; i < total; ++i) {
    const SweepSetting& setting = settings[i];
    Trial trial{
        .part = "sweep", .axis = setting.axis, .setting = setting.text, .is_default = setting.is_default};
    trial.error_name = "NMAD + 10 (1 - complete), GSD";
    std::vector<double> processor, wall;
    std::vector<double> sweep_s;
    tiling::Comparison comparison;
    std::size_t tile_count = 0;
    tiling::MapperStatistics statistics;
    // The first run of all compiles the shaders and fills the file cache: not counted.
    const int runs = repeats + (i == 0 ? 1 : 0);
    for (int run = 0; run < runs; ++run) {
      progress(i, total, setting.text);
      tiling::BatchOptions options;
      options.mapper = setting.options;
      options.reduce = setting.reduce;
      if (setting.coarser > 0 && native) options.ground.gsd_m = native->gsd_m * (1 << setting.coarser);
      Result<tiling::MappedTiles> made = fail(ErrorCode::Internal, "not run");
      const Elapsed elapsed =
          elapsedOf([&] { made = tiling::mapFlightToTiles(context, reference.flight, options); });
      if (!made) return tl::unexpected(made.error());
      const auto& [mapped, tiles] = *made;
      if (tiles.empty()) return fail(ErrorCode::BadInput, "no tile could be made of " + reference.name);
      if (i == 0 && run == 0) continue;
      if (!native) native = mapped.ground;
      const double count =
          std::ldexp(static_cast<double>(tiles.size()), 2 * (native->base_zoom - mapped.ground.base_zoom));
      processor.push_back(elapsed.processor_ms / count);
      wall.push_back(elapsed.wall_ms / count);
      statistics = mapped.statistics;
      sweep_s.push_back(statistics.sweep_processor_s);
      tile_count = tiles.size();
      comparison =
          tiling::compare(tiles, mapped.ground.lattice, mapped.ground.base_zoom, mapped.ground.anchor_px,
                          reference.points, native->gsd_m, reference.strong_track);
    }
    trial.processor = timingOf(processor);
    trial.wall = timingOf(wall);
    const tiling::ErrorStatistics& e = comparison.strong;
    trial.error = e.nmad + 10 * (1 - e.complete);
    const Timing sweep = timingOf(sweep_s);
    trial.figures = {
        {"complete", e.complete},
        {"median_gsd", e.median},
        {"nmad_gsd", e.nmad},
        {"rmse_gsd", e.rmse},
        {"p99_gsd", e.p99},
        {"beyond_10_gsd", e.beyond_10},
        {"tiles", static_cast<double>(tile_count)},
        {"sweep_ms_per_cell",
         1000 * sweep.median_ms / static_cast<double>(std::max<std::uint64_t>(statistics.cells_swept, 1))},
        {"million_samples", static_cast<double>(statistics.samples) / 1e6}};
    if (setting.point) {
      daemon::OperatingPoint point = *setting.point;
      point.relative_time = sweep.median_ms;
      point.nmad_gsd = e.nmad;
      point.complete = e.complete;
      slowest_sweep = std::max(slowest_sweep, point.relative_time);
      result.points.push_back(std::move(point));
    }
    result.trials.push_back(std::move(trial));
  }
  progress(total, total, "");
  for (daemon::OperatingPoint& point : result.points) point.relative_time /= slowest_sweep;
  markFront(result.trials);
  return result;
}

std::vector<daemon::OperatingPoint> combined(const std::vector<std::vector<daemon::OperatingPoint>>& lists) {
  if (lists.empty()) return {};
  std::vector<daemon::OperatingPoint> points = lists.front();
  const auto count = static_cast<double>(lists.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    double log_time = 0, nmad = 0, complete = 0;
    for (const std::vector<daemon::OperatingPoint>& list : lists) {
      log_time += std::log(list.at(i).relative_time);
      nmad += list[i].nmad_gsd;
      complete += list[i].complete;
    }
    points[i].relative_time = std::exp(log_time / count);
    points[i].nmad_gsd = nmad / count;
    points[i].complete = complete / count;
  }
  return points;
}

}  // namespace overfly::tradeoff
