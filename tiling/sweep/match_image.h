#pragma once
#include <memory>

#include "config/error.h"
#include "render/gl/context.h"
#include "render/gl/texture.h"

namespace overfly::tiling {

struct MatchImageOptions {
  int radius = 2;      // pixels of each level; window of the local mean and deviation, (2 r + 1)^2
  double noise = 3.0;  // grey levels of 255; deviations well below are not amplified
  int levels = 5;      // mip levels made
};

// Makes the images that the sweep correlates: every mip level of a frame's luminance minus its local mean,
// over its local deviation, in one byte around 128 (42 steps per deviation); 0 marks pixels outside the
// valid image. Normalising per image instead of per window makes the correlation of n views at a texel cost
// n samples. Thread-bound to the context's thread.
class MatchImageMaker {
 public:
  [[nodiscard]] static Result<std::unique_ptr<MatchImageMaker>> create(gl::Context& context,
                                                                       const MatchImageOptions& options = {});
  ~MatchImageMaker();

  // `luma`: R8 with mips; `color`: RGBA8 of the same size, alpha = valid.
  [[nodiscard]] Result<gl::Texture> make(const gl::Texture& luma, const gl::Texture& color);

 private:
  struct Impl;
  explicit MatchImageMaker(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace overfly::tiling
