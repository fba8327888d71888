#include "tiling/clipmap/improvable.h"

namespace overfly::tiling {

double knowledgeOf(const FrameIndex& index, const geo::TileKey& key, double surface_height_m,
                   const ViewSelectionOptions& options) {
  double knowledge = 0;
  for (const SelectedView& view : selectViews(index.framesForTile(key, surface_height_m, surface_height_m),
                                              index.lattice(), key, surface_height_m, options))
    knowledge += view.gain;
  return knowledge;
}

std::vector<Improvement> improvableTiles(const FrameIndex& index, std::uint64_t frame_id, int zoom,
                                         double surface_height_m, const ViewSelectionOptions& options) {
  std::vector<Improvement> result;
  const IndexedFrame* frame = index.find(frame_id);
  if (frame == nullptr) return result;
  for (const geo::TileKey& key : FrameIndex::tilesUnder(*frame, zoom)) {
    const auto candidates = index.framesForTile(key, surface_height_m, surface_height_m);
    for (const SelectedView& view : selectViews(candidates, index.lattice(), key, surface_height_m, options))
      if (view.id == frame_id) result.push_back({key, view.gain});
  }
  return result;
}

}  // namespace overfly::tiling
