#pragma once
#include <cstdint>
#include <string>

#include "render/gl/context.h"

namespace overfly::bench {

// Coarse to fine against the whole range on the finest grid, both ZNCC, on cells that a seed chooses: image
// samples read and errors. Returns whether 20 times fewer samples give an NMAD within 5 %.
[[nodiscard]] bool proof(gl::Context& context, const std::string& flight, int tiles, std::uint32_t seed);

// The device's peak of bilinear reads, and the share of it that the full sweep (SAD, one texel) reaches.
void peak(gl::Context& context, const std::string& flight);

// Median height step across the borders of a mapped flight's tiles and swept cells, against that of all other
// lines. Returns whether both are at most 1.05 times it.
[[nodiscard]] bool borders(gl::Context& context, const std::string& flight);

// Time and error for numbers of images, windows, costs, all or the better half of the images and plane steps:
// the shape of the thesis's table 5.1, with errors beside the times, and upload apart from sweep.
void table(gl::Context& context, const std::string& flight, int texels);

}  // namespace overfly::bench
