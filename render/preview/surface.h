#pragma once
#include <array>
#include <string_view>

namespace overfly::preview {

// What the texels' heights are joined to.
enum class Surface {
  Blocks,   // every texel a box
  Linear,   // bilinear between texel centres
  Bicubic,  // Hermite patches, one per texel (thesis, (4.9)-(4.14))
};
[[nodiscard]] constexpr std::string_view surfaceName(Surface surface) {
  return surface == Surface::Blocks ? "blocks" : surface == Surface::Linear ? "linear" : "bicubic";
}

// Heights of a texel and its neighbours, row by row from the north-west: [3 * row + column], 4 is the texel.
using Neighbourhood = std::array<double, 9>;

// Height of the surface over the texel, (u, v) in [0, 1]^2 from its north-west corner.
[[nodiscard]] double surfaceHeight(Surface surface, const Neighbourhood& h, double u, double v);

}  // namespace overfly::preview
