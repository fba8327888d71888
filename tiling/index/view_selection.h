#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "capture/geo/geodetic.h"
#include "tiling/index/indexed_frame.h"

namespace overfly::tiling {

struct ViewSelectionOptions {
  int max_views = 12;            // more views: more texels seen free of occlusion, more time per tile
  double min_overlap = 0.01;     // share of the tile that a view must cover
  double min_gain = 0.005;       // a view that adds less is not chosen (one beside another, without parallax)
  double max_obliqueness = 0.7;  // radians between the line of sight and the vertical, where it sees the tile
  // Parallax angles (radians) between two views at the tile: below the first value a pair tells little about
  // height, beyond the last one matching fails; between the middle two it is best.
  double parallax_low = geo::radians(1.2), parallax_best_from = 0.12, parallax_best_to = 0.45;
  double parallax_high = geo::radians(50);
};

struct SelectedView {
  std::uint64_t id = 0;
  double overlap = 0;      // share of the tile that the frame sees, 0..1
  double obliqueness = 0;  // of the line of sight to the middle of what it sees of the tile, radians
  double gsd_m = 0;        // there
  double gain = 0;         // what it added when it was chosen: comparable within one result
};

// Which frames a tile is made from: at most max_views of the candidates, best first. A pure function of the
// set of candidates (order and duplicates do not matter; ties go to the lower id), so that a tile is a
// function of its frame set. Greedy: each step takes the view that adds most over the tile, where a view's
// worth is its coverage times obliqueness, sharpness (relative to the candidates' median) and GSD (relative
// to the finest), a place that is already seen n times counts 1 / (1 + n), and a view whose parallax to those
// already chosen is too small or too large counts less. The first view is the best by worth alone.
[[nodiscard]] std::vector<SelectedView> selectViews(std::span<const IndexedFrame* const> candidates,
                                                    const geo::TileLattice& lattice, const geo::TileKey& key,
                                                    double surface_height_m,
                                                    const ViewSelectionOptions& options = {});

// Distributes frames among sets of at most `max_per_set` that overlap each other (thesis, 5.2.1, figure 5.3):
// for machines that can sweep only a few images at a time. Sets need not be disjoint; a frame that overlaps
// no other by `min_share` of the smaller footprint is in none. Each set begins with the frame it was made
// for; ids in the order of falling overlap with it. Deterministic over the set of frames.
//
// Where the thesis's text would end a set as soon as no unused overlapping image is left, its own figure 5.3
// ({A, B}, {B, C}) needs used images to be added too: that is what is done here.
[[nodiscard]] std::vector<std::vector<std::uint64_t>> distributeViews(
    std::span<const IndexedFrame* const> frames, double surface_height_m, int max_per_set,
    double min_share = 0.05);

}  // namespace overfly::tiling
