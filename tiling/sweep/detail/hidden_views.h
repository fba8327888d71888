#pragma once
#include <map>
#include <span>

#include "render/gl/context.h"
#include "render/gl/framebuffer.h"
#include "render/gl/program.h"
#include "render/gl/texture.h"
#include "tiling/sweep/detail/texel_blocks.h"
#include "tiling/sweep/detail/view_geometry.h"

namespace overfly::tiling::detail {

// A surface that may hide texels of a cell from views. Borrowed for the call.
struct Occluder {
  std::span<const float> height;         // above ViewGeometry::reference_height_m, side x side, finite
  int texels = 0;                        // of the cell
  int apron = 0;                         // its own texels around the cell
  const gl::Texture* texture = nullptr;  // R32F: the same heights
  const gl::Texture* own = nullptr;      // R32F, as large: where texels without a base lie

  [[nodiscard]] int side() const { return texels + 2 * apron; }
};

// What counts as hidden: the surface stands above the line of sight by more than `clearance_m` and `share` of
// the height gained, further from the texel than `rim` of the surface's texels.
struct HidingRule {
  double rim = 1.5;
  double clearance_m = 0;
  double share = 0;
};

// Which views cannot see the texels of a grid, by a march along each line of sight (hidden.glsl).
// Thread-bound to the context's thread.
class HiddenViews {
 public:
  explicit HiddenViews(gl::Context& context) : context_(&context) {}

  // A grid's texels at their own heights, base + offset_m.
  struct Base {
    const gl::Texture* height = nullptr;  // R32F, the grid's side
    double offset_m = 0;
    const TexelBlocks* wanted = nullptr;  // the others are left as they are
  };
  // Draws into `target` (R32F, the grid's side), for every texel a whole number whose bit k says that view k
  // is hidden. Without a base the texels lie at occluder.own.
  [[nodiscard]] Result<void> mark(const ViewGeometry& geometry, int grid_texels, int grid_apron,
                                  const Occluder& occluder, const Base* base, const HidingRule& rule,
                                  gl::Framebuffer& target);

 private:
  Result<gl::Program*> programOf(int views, bool on_surface);
  Result<gl::Texture*> ceilingOf(const Occluder& occluder);

  gl::Context* context_;
  std::map<std::pair<int, bool>, gl::Program> programs_;
  std::map<int, gl::Texture> ceilings_;  // by side of the surface
};

}  // namespace overfly::tiling::detail
