#pragma once
#include <vector>

#include "render/gl/context.h"
#include "render/gl/framebuffer.h"
#include "render/gl/program.h"
#include "render/gl/vertex_array.h"
#include "render/preview/clip_cache.h"
#include "render/preview/map_textures.h"
#include "render/preview/view.h"

namespace overfly::bench {

// The same tiles drawn the usual way, as a clipmap mesh: chunks of 32 by 32 texels, each at the coarsest
// level whose texels cover no more than asked for at its middle, two triangles a texel, heights from the same
// textures, rasterised with a depth buffer, coloured by the same trilinear filter. The cracks between levels
// stay open, in the mesh's favour.
class MeshPeer {
 public:
  [[nodiscard]] static Result<MeshPeer> create(gl::Context& context, const preview::MapTextures& textures,
                                               int tile_size);
  // Draws and waits. A texel is at least `texel_pixels` and less than twice that wide on the picture where
  // the map has such. Returns the number of triangles.
  [[nodiscard]] Result<std::size_t> draw(gl::Context& context, const preview::View& view,
                                         const preview::RayFrame& frame, const preview::ClipCache& cache,
                                         const preview::MapTextures& textures, double texel_pixels);
  [[nodiscard]] Result<std::vector<std::uint8_t>> read() const;

 private:
  int tile_size_ = 0;
  gl::Program program_;
  gl::Buffer corners_, indices_;
  gl::VertexArray grid_;
  std::size_t index_count_ = 0;
  gl::Texture color_, depth_;
  gl::Framebuffer target_;
};

}  // namespace overfly::bench
