#pragma once
#include <cstdint>
#include <vector>

#include "tiling/index/frame_index.h"
#include "tiling/index/view_selection.h"

namespace overfly::tiling {

struct Improvement {
  geo::TileKey key;
  double gain = 0;  // SelectedView::gain: what the frame adds to the views already there
};

// What the chosen views of a tile tell together: the sum of their gains (see SchedulerOptions).
[[nodiscard]] double knowledgeOf(const FrameIndex& index, const geo::TileKey& key, double surface_height_m,
                                 const ViewSelectionOptions& options = {});

// The tiles at a zoom that a frame of the index can improve: those beneath it whose choice of views, over all
// frames of the index, has it among the chosen. (A frame that is not chosen cannot change a tile, because a
// tile is a function of its chosen set.) Empty for an unknown or oblique frame. Ascending keys.
[[nodiscard]] std::vector<Improvement> improvableTiles(const FrameIndex& index, std::uint64_t frame_id,
                                                       int zoom, double surface_height_m,
                                                       const ViewSelectionOptions& options = {});

}  // namespace overfly::tiling
