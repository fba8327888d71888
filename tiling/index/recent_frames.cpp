#include "tiling/index/recent_frames.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include "tiling/index/detail/convex.h"

namespace overfly::tiling {
namespace {

constexpr std::size_t kSamples = 8;  // per axis: places of the tile at which views are counted
// Views differ in their other merits by at most about ten.
constexpr double kFarLess = 1.0 / 16;

double ageOf(const IndexedFrame& frame, const IndexedFrame& newest) {
  return static_cast<double>(newest.utc_ns - frame.utc_ns) / 1e9;
}

}  // namespace

std::vector<const IndexedFrame*> recentFrames(std::span<const IndexedFrame* const> candidates,
                                              const geo::TileLattice& lattice, const geo::TileKey& key,
                                              double surface_height_m, const RecencyOptions& options) {
  std::vector<const IndexedFrame*> newest(candidates.begin(), candidates.end());
  std::sort(newest.begin(), newest.end(), [](const IndexedFrame* a, const IndexedFrame* b) {
    return std::tuple(a->utc_ns, a->id) > std::tuple(b->utc_ns, b->id);
  });
  if (options.prefer == Prefer::Best) return newest;
  std::array<int, kSamples * kSamples> views{};
  std::vector<const IndexedFrame*> kept;
  for (const IndexedFrame* frame : newest) {
    const auto polygon =
        detail::footprintInTile(*frame, surface_height_m, key, detail::turnsBetween(*frame, key, lattice));
    bool needed = options.prefer == Prefer::MaxAge && ageOf(*frame, *newest.front()) <= options.max_age_s;
    std::array<bool, kSamples * kSamples> sees{};
    for (std::size_t place = 0; place < sees.size(); ++place) {
      sees[place] = detail::contains(polygon, {(static_cast<double>(place % kSamples) + 0.5) / kSamples,
                                               (static_cast<double>(place / kSamples) + 0.5) / kSamples});
      needed = needed || (sees[place] && views[place] < options.enough);
    }
    if (!needed) continue;
    kept.push_back(frame);
    for (std::size_t place = 0; place < sees.size(); ++place) views[place] += sees[place] ? 1 : 0;
  }
  return kept;
}

std::vector<double> recencyWorth(std::span<const IndexedFrame* const> newest_first,
                                 const RecencyOptions& options) {
  std::vector<double> worth(newest_first.size(), 1.0);
  for (std::size_t i = 0; i < worth.size(); ++i)
    if (options.prefer == Prefer::Latest)
      worth[i] = std::pow(kFarLess, static_cast<double>(i));
    else if (options.prefer == Prefer::MaxAge &&
             ageOf(*newest_first[i], *newest_first[0]) > options.max_age_s)
      worth[i] = std::pow(kFarLess, 3);
  return worth;
}

}  // namespace overfly::tiling
