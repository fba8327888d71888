#pragma once
#include <memory>
#include <vector>

#include "config/error.h"
#include "render/gl/context.h"
#include "render/gl/program.h"
#include "render/gl/texture.h"
#include "render/preview/clip_cache.h"

namespace overfly::preview {

// The clip cache's tiles in GPU memory: one texture array per layer, several tiles across on each of the
// array's layers (256 layers is all that OpenGL ES 3.1 promises), the top in a slot and its mip levels in one
// more, so that shaders read every level in the same way, and the table by which they find a tile.
// Thread-bound to its context.
class MapTextures : public TextureSink {
 public:
  // Unavailable: no memory for so many tiles (`slots`, of `tile_size` texels).
  [[nodiscard]] static Result<std::unique_ptr<MapTextures>> create(gl::Context& context, int tile_size,
                                                                   int slots);

  void uploadTile(int slot, const TileImage& image) override;
  void uploadBounds(int slot, const BoundsPatch& patch) override;
  void uploadTop(const TopImage& top) override;
  void uploadTopBounds(int mip, const BoundsPatch& patch) override;
  // The table and windows as the cache has them now; call after its update().
  [[nodiscard]] Result<void> uploadTable(gl::Context& context, const ClipCache& cache);

  // Binds everything to units 0 .. kUnits-1 and sets the uniforms of shaders/map.glsl but origin_cell.
  void bind(gl::Program& program) const;
  static constexpr int kUnits = 5;
  // The defines of shaders/map.glsl.
  [[nodiscard]] std::vector<gl::Define> defines() const;
  [[nodiscard]] std::size_t bytes() const;
  // GPU memory that one tile takes.
  [[nodiscard]] static std::size_t bytesPerTile(int tile_size);

 private:
  MapTextures(int tile_size, int atlas, int slots) : tile_size_(tile_size), atlas_(atlas), top_slot_(slots) {}
  // Where a tile lies on its layer; where one of the top's levels does, the top itself being mip 0.
  [[nodiscard]] gl::Rect place(int slot, int rim) const;
  [[nodiscard]] gl::Rect topPlace(int mip, int rim) const;
  [[nodiscard]] int topSlot(int mip) const { return top_slot_ + (mip > 0 ? 1 : 0); }

  int tile_size_, atlas_;
  int top_slot_;  // after all tiles'
  gl::Texture heights_, bounds_, color_, quality_;
  gl::Texture table_;
  int table_stride_ = 0, top_level_ = 0, last_level_ = 0;
  std::vector<Eigen::Vector4f> windows_;
};

}  // namespace overfly::preview
