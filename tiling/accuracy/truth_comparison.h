#pragma once
#include <map>
#include <span>

#include "capture/camera_model.h"
#include "capture/geo/tile_lattice.h"
#include "render/scene/flight_plan.h"
#include "render/scene/truth.h"
#include "tiling/accuracy/accuracy.h"
#include "tiling/tile.h"

namespace overfly::tiling {

// Where a map's level-0 tiles lie and what its errors are counted in.
struct MapPlace {
  geo::TileLattice lattice = geo::TileLattice::webMercator();
  int zoom = 0;        // of the tiles
  double gsd_m = 0;    // unit of the height errors
  double texel_m = 0;  // side over which the true colour is filtered
};

struct TruthOptions {
  int stride = 4;      // every so many texels are compared, in both directions
  int min_frames = 3;  // places that fewer frames have within their picture are not asked for
};

// Difference of luminance (Rec. 601, 0..255) between orthophoto and truth; texels that any frame covers.
struct ColourStatistics {
  std::size_t texels = 0;
  double median = 0, p95 = 0;  // of the absolute difference
  double beyond_32 = 0;        // share
};

// Height errors in multiples of the GSD, map minus truth; a height that was filled in, not measured, does not
// count as one.
struct TruthComparison {
  ErrorStatistics all, ground, solids, plants;  // by what is really there
  ErrorStatistics seen, hidden;  // places that two frames or more see, and those that other things hide
  ColourStatistics colour;
};

// Compares tiles texel by texel with the scene they were mapped from: the truth's own tile of the same
// lattice, sampled at texel centres. The area asked for is the tiles' bounding box, where at least
// `min_frames` frames of the plan (exact poses) have the true surface within their picture; occlusion is not
// considered, so that what no frame sees counts as incomplete. The true colour has sun shadows where the
// scene names them, and no other effect. Reentrant; uses two threads.
[[nodiscard]] TruthComparison compareWithTruth(const std::map<geo::TileKey, Tile>& tiles,
                                               const MapPlace& place, const scene::Truth& truth,
                                               const scene::FlightPlan& plan,
                                               const capture::CameraModel& camera,
                                               const TruthOptions& options = {});

}  // namespace overfly::tiling
