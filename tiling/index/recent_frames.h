#pragma once
#include <span>
#include <vector>

#include "tiling/index/indexed_frame.h"

namespace overfly::tiling {

// Which frames win where there are more than enough (the ratings of the GRAPP paper).
enum class Prefer {
  Best,    // whenever they were taken
  Latest,  // the newest: the map shows the scene as it is now
  MaxAge,  // the best of those not older than max_age_s before the newest frame that sees the place
};

struct RecencyOptions {
  Prefer prefer = Prefer::Best;
  double max_age_s = 0;
  int enough = 4;  // views of a place: more than two, so that heights are measured and not only possible
};

// The candidates that count for a tile, newest first. With Best all of them. Otherwise from the newest on,
// those that are needed: a frame is left out when it is too old (Latest: any age is) and every place of the
// tile that it sees (on the surface at the given height) is seen by `enough` newer ones. A function of the
// set of candidates; of equal times the higher id is the newer.
[[nodiscard]] std::vector<const IndexedFrame*> recentFrames(std::span<const IndexedFrame* const> candidates,
                                                            const geo::TileLattice& lattice,
                                                            const geo::TileKey& key, double surface_height_m,
                                                            const RecencyOptions& options);

// What each of them, as returned, is worth for the colour beside its other merits: with Latest so much less
// than the next newer one that it shows only where no newer one does; with MaxAge so for those too old.
[[nodiscard]] std::vector<double> recencyWorth(std::span<const IndexedFrame* const> newest_first,
                                               const RecencyOptions& options);

}  // namespace overfly::tiling
