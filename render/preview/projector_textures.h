#pragma once
#include <array>
#include <optional>
#include <span>

#include "render/gl/context.h"
#include "render/gl/program.h"
#include "render/gl/texture.h"
#include "render/preview/projector.h"

namespace overfly::preview {

// The photographs that a view throws onto the surface, in one texture array with mip levels. Thread-bound to
// its context.
class ProjectorTextures {
 public:
  static constexpr int kMost = 8;
  struct Options {
    int width = 1024, height = 768;  // pixels of each: 34 MB for all eight
  };

  // Unavailable: no memory.
  [[nodiscard]] static Result<ProjectorTextures> create(gl::Context& context, const Options& options);

  // Makes `chosen` (kMost at most) the photographs that are shown, as far as they are there: those that were
  // shown before stay in place, at most `loads` others are loaded. Returns how many are still to be loaded,
  // or to be read by the source. One whose picture cannot be had is left out.
  int update(ProjectorSource& source, std::span<const Projector> chosen, int loads);

  [[nodiscard]] int count() const;
  [[nodiscard]] std::size_t bytes() const { return images_.bytes(); }
  // Sets the uniforms of shaders/lateral.glsl, for a program with PROJECTORS = count() > 0.
  void bind(gl::Program& program, int unit, const View& view) const;

 private:
  struct Slot {
    Projector projector;
    capture::CameraModel pinhole;
    bool shown = false;
  };
  gl::Texture images_;
  std::array<std::optional<Slot>, kMost> slots_;  // by layer
};

}  // namespace overfly::preview
