#include "tiling/index/view_selection.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "capture/geo/geodetic.h"
#include "tiling/index/detail/convex.h"

namespace overfly::tiling {
namespace {

constexpr int kSamples = 8;  // per axis: places of the tile at which views are counted
constexpr std::size_t kPlaces = kSamples * kSamples;

struct Candidate {
  const IndexedFrame* frame = nullptr;
  SelectedView view;
  Eigen::Vector3d sight;  // unit, from the tile's centre to the camera, ECEF
  double worth = 0;       // obliqueness, sharpness, GSD; 0..1
  std::array<bool, kPlaces> sees{};
  // Per place, over the chosen views that see it: best rating of a pair's parallax, smallest novelty.
  std::array<double, kPlaces> best_pair{}, novelty{};
  bool chosen = false;
};

std::vector<const IndexedFrame*> distinctById(std::span<const IndexedFrame* const> frames) {
  std::vector<const IndexedFrame*> sorted(frames.begin(), frames.end());
  std::sort(sorted.begin(), sorted.end(), [](auto* a, auto* b) { return a->id < b->id; });
  sorted.erase(std::unique(sorted.begin(), sorted.end(), [](auto* a, auto* b) { return a->id == b->id; }),
               sorted.end());
  return sorted;
}

double angleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

// 0 below low and beyond high, 1 in the best range, linear between.
double parallaxRating(double angle, const ViewSelectionOptions& options) {
  if (angle < options.parallax_best_from)
    return std::clamp((angle - options.parallax_low) / (options.parallax_best_from - options.parallax_low),
                      0.0, 1.0);
  return std::clamp((options.parallax_high - angle) / (options.parallax_high - options.parallax_best_to), 0.0,
                    1.0);
}

// Views along (nearly) the line of sight of a chosen one show nothing new.
double parallaxNovelty(double angle, const ViewSelectionOptions& options) {
  return std::min(1.0, angle / options.parallax_best_from);
}

std::vector<Candidate> usable(std::span<const IndexedFrame* const> frames, const geo::TileLattice& lattice,
                              const geo::TileKey& key, double surface_height_m,
                              const ViewSelectionOptions& options) {
  geo::Geodetic centre = lattice.geodeticFromPlane(geo::TileLattice::planeOf(key, 0.5, 0.5));
  centre.height_m = surface_height_m;
  const Eigen::Vector3d centre_in_ecef = geo::ecefFromGeodetic(centre);
  const Eigen::Vector3d up = geo::upInEcef(centre.lat, centre.lon);
  const std::array<Eigen::Vector2d, 4> square = {Eigen::Vector2d(0, 0), Eigen::Vector2d(1, 0),
                                                 Eigen::Vector2d(1, 1), Eigen::Vector2d(0, 1)};
  std::vector<Candidate> candidates;
  for (const IndexedFrame* frame : distinctById(frames)) {
    if (!frame->near_vertical || !(frame->camera_height_m > surface_height_m)) continue;
    Candidate c;
    c.frame = frame;
    c.view.id = frame->id;
    c.sight = (frame->pose.position_in_ecef - centre_in_ecef).normalized();
    const auto polygon =
        detail::footprintInTile(*frame, surface_height_m, key, detail::turnsBetween(*frame, key, lattice));
    const auto seen = detail::intersection(polygon, square);
    c.view.overlap = detail::area(seen);
    if (!(c.view.overlap >= options.min_overlap)) continue;
    for (std::size_t place = 0; place < kPlaces; ++place)
      c.sees[place] = detail::contains(polygon, {(static_cast<double>(place % kSamples) + 0.5) / kSamples,
                                                 (static_cast<double>(place / kSamples) + 0.5) / kSamples});
    c.novelty.fill(1);
    // Obliqueness and GSD where the frame sees the tile, which need not be the tile's centre.
    Eigen::Vector2d middle = Eigen::Vector2d::Zero();
    for (const Eigen::Vector2d& p : seen) middle += p / static_cast<double>(seen.size());
    geo::Geodetic at = lattice.geodeticFromPlane(geo::TileLattice::planeOf(key, middle.x(), middle.y()));
    at.height_m = surface_height_m;
    const Eigen::Vector3d to_camera = frame->pose.position_in_ecef - geo::ecefFromGeodetic(at);
    c.view.obliqueness = angleBetween(to_camera, up);
    if (c.view.obliqueness > options.max_obliqueness) continue;
    c.view.gsd_m = to_camera.norm() / std::sqrt(frame->camera.fx * frame->camera.fy *
                                                std::max(std::cos(c.view.obliqueness), 0.05));
    candidates.push_back(c);
  }
  return candidates;
}

void rate(std::vector<Candidate>& candidates) {
  double finest_gsd_m = std::numeric_limits<double>::infinity();
  std::vector<double> sharpness;
  for (const Candidate& c : candidates) {
    finest_gsd_m = std::min(finest_gsd_m, c.view.gsd_m);
    if (c.frame->sharpness > 0) sharpness.push_back(c.frame->sharpness);
  }
  double median = 0;
  if (!sharpness.empty()) {
    const auto middle = sharpness.begin() + static_cast<std::ptrdiff_t>(sharpness.size() / 2);
    std::nth_element(sharpness.begin(), middle, sharpness.end());
    median = *middle;
  }
  for (Candidate& c : candidates) {
    const double slant = std::cos(c.view.obliqueness);
    const double sharp = c.frame->sharpness > 0 ? std::min(1.0, c.frame->sharpness / median) : 1.0;
    c.worth = slant * slant * sharp * (finest_gsd_m / c.view.gsd_m);
  }
}

}  // namespace

std::vector<SelectedView> selectViews(std::span<const IndexedFrame* const> frames,
                                      const geo::TileLattice& lattice, const geo::TileKey& key,
                                      double surface_height_m, const ViewSelectionOptions& options) {
  std::vector<Candidate> candidates = usable(frames, lattice, key, surface_height_m, options);
  rate(candidates);
  std::array<int, kPlaces> views_at{};
  std::vector<SelectedView> selected;
  while (selected.size() < static_cast<std::size_t>(std::max(options.max_views, 0))) {
    Candidate* best = nullptr;
    double best_gain = std::max(options.min_gain, 0.0);
    for (Candidate& c : candidates) {
      if (c.chosen) continue;
      double sum = 0;
      for (std::size_t place = 0; place < kPlaces; ++place)
        if (c.sees[place])
          sum += views_at[place] == 0 ? 1.0 : c.best_pair[place] * c.novelty[place] / (1.0 + views_at[place]);
      // The overlap decides among views that see the same places.
      const double gain = c.worth * (sum / kPlaces + 1e-3 * c.view.overlap);
      if (gain > best_gain) {
        best = &c;
        best_gain = gain;
      }
    }
    if (best == nullptr) break;
    best->chosen = true;
    best->view.gain = best_gain;
    selected.push_back(best->view);
    for (std::size_t place = 0; place < kPlaces; ++place) views_at[place] += best->sees[place] ? 1 : 0;
    for (Candidate& c : candidates) {
      if (c.chosen) continue;
      const double angle = angleBetween(c.sight, best->sight);
      const double pair = parallaxRating(angle, options), novelty = parallaxNovelty(angle, options);
      for (std::size_t place = 0; place < kPlaces; ++place)
        if (best->sees[place]) {
          c.best_pair[place] = std::max(c.best_pair[place], pair);
          c.novelty[place] = std::min(c.novelty[place], novelty);
        }
    }
  }
  return selected;
}

std::vector<std::vector<std::uint64_t>> distributeViews(std::span<const IndexedFrame* const> frames,
                                                        double surface_height_m, int max_per_set,
                                                        double min_share) {
  std::vector<const IndexedFrame*> sorted = distinctById(frames);
  std::erase_if(sorted, [](const IndexedFrame* frame) { return !frame->near_vertical; });
  const std::size_t n = sorted.size();
  if (n == 0 || max_per_set < 2) return {};

  // Footprints relative to the first one and in its size: areas are compared, their unit does not matter.
  std::vector<std::array<Eigen::Vector2d, 4>> polygons(n);
  const Eigen::Vector2d origin = sorted[0]->nadir;
  const double unit = std::max((sorted[0]->footprint[2] - sorted[0]->footprint[0]).norm(), 1e-12);
  for (std::size_t i = 0; i < n; ++i) {
    polygons[i] = sorted[i]->footprintAt(surface_height_m);
    for (Eigen::Vector2d& p : polygons[i]) p = (p - origin) / unit;
  }
  std::vector<double> area(n);
  std::vector<std::vector<double>> common(n, std::vector<double>(n, 0));
  for (std::size_t i = 0; i < n; ++i) {
    area[i] = detail::area(polygons[i]);
    for (std::size_t j = 0; j < i; ++j) {
      const double a = detail::area(detail::intersection(polygons[i], polygons[j]));
      if (a > 0 && a >= min_share * std::min(area[i], area[j])) common[i][j] = common[j][i] = a;
    }
  }

  std::vector<std::vector<std::uint64_t>> sets;
  std::vector<bool> used(n, false);
  for (std::size_t k = 0; k < n; ++k) {
    if (used[k]) continue;
    used[k] = true;
    std::vector<std::size_t> others;
    for (std::size_t i = 0; i < n; ++i)
      if (common[k][i] > 0) others.push_back(i);
    std::stable_sort(others.begin(), others.end(),
                     [&](std::size_t a, std::size_t b) { return common[k][a] > common[k][b]; });
    others.resize(std::min(others.size(), static_cast<std::size_t>(max_per_set) - 1));
    if (others.empty()) continue;
    std::vector<std::uint64_t>& set = sets.emplace_back();
    set.push_back(sorted[k]->id);
    for (const std::size_t i : others) {
      set.push_back(sorted[i]->id);
      used[i] = true;
    }
  }
  return sets;
}

}  // namespace overfly::tiling
