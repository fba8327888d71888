#pragma once
#include <memory>
#include <optional>

#include "render/gl/context.h"
#include "render/preview/clip_cache.h"
#include "render/preview/map_textures.h"
#include "render/preview/ray_caster.h"

namespace overfly::preview {

// One view of a map: its clip cache, its share of GPU memory, and the caster. Several views may share a RAM
// cache. A map that grows is followed. Thread-bound to the context.
class Previewer {
 public:
  struct Options {
    std::size_t gpu_bytes = 256u << 20;  // for tiles
    int active = 7;                      // tiles across a level's active area, memory permitting
    LoadOrder order = LoadOrder::DetailFirst;
  };
  struct Frame {
    Picture picture;
    ClipCache::Update update;
    int refinements = 0;  // of updates made for this picture
    int projectors = 0;   // photographs that were there for it
  };

  // `ram` and its source outlive the previewer.
  Previewer(gl::Context& context, RamCache& ram, const Options& options);
  Previewer(gl::Context& context, RamCache& ram) : Previewer(context, ram, Options{}) {}
  ~Previewer();

  // A picture of what is in GPU memory after an update within the budget. Unavailable while the map is empty
  // or its coarsest tiles are not in RAM yet; BadInput: a view that cannot be drawn.
  [[nodiscard]] Result<Frame> draw(const View& view, const Look& look, const ClipCache::Budget& budget,
                                   bool hits = false);
  // The update of draw() without a picture: brings tiles and photographs to the GPU until it is settled and
  // projectorsLeft() is none.
  [[nodiscard]] Result<ClipCache::Update> refine(const View& view, const Look& look,
                                                 const ClipCache::Budget& budget);
  // The best picture there is: loads and uploads all that the view calls for first, on this thread.
  [[nodiscard]] Result<Frame> drawSettled(const View& view, const Look& look, bool hits = false);
  // Where the photographs for Look::projectors come from; null: there are none. It outlives the previewer.
  // draw() and refine() load at most one of them, drawSettled() all. They stay in GPU memory for the next
  // look that asks for some.
  void setProjectors(ProjectorSource* source) { projector_source_ = source; }
  // Drops what is in GPU memory: after a lost context's objects are gone, and to change Look::no_data.
  void reset();

  // Latitude, longitude (radians) and height of a hit.
  [[nodiscard]] geo::Geodetic placeOf(const RayHit& hit) const;
  // Photographs that the last look asked for and that are not there yet.
  [[nodiscard]] int projectorsLeft() const { return projectors_left_; }
  // Null until something was drawn.
  [[nodiscard]] const ClipCache* cache() const { return cache_.get(); }
  [[nodiscard]] const MapTextures* textures() const { return textures_.get(); }
  [[nodiscard]] RayCaster& caster() { return caster_; }
  // The frame that the last view was drawn in.
  [[nodiscard]] const std::optional<RayFrame>& frame() const { return frame_; }

 private:
  [[nodiscard]] Result<void> prepare(const Look& look);
  [[nodiscard]] Result<ClipCache::Update> update(const View& view, const ClipCache::Budget& budget);
  [[nodiscard]] Result<void> updateProjectors(const View& view, const Look& look, int loads);
  [[nodiscard]] int shownProjectors(const Look& look) const;

  gl::Context& context_;
  RamCache& ram_;
  Options options_;
  RayCaster caster_;
  std::unique_ptr<MapTextures> textures_;
  std::unique_ptr<ClipCache> cache_;  // after the textures that it writes to
  ProjectorSource* projector_source_ = nullptr;
  std::optional<ProjectorTextures> projectors_;
  int projectors_left_ = 0;
  NoData no_data_ = NoData::Hole;
  std::optional<RayFrame> frame_;
  std::optional<Focus> focus_;
};

}  // namespace overfly::preview
