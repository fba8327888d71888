#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "render/gl/buffer.h"
#include "render/gl/framebuffer.h"
#include "render/gl/program.h"
#include "render/gl/vertex_array.h"

namespace overfly::tiling::detail {

// Draws the parts of a square target that a mask wants, in blocks of kSize squared texels: a few more texels
// than wanted, and no work for the others. On a GPU without points of that size it draws the whole target.
// Thread-bound to its context.
class TexelBlocks {
 public:
  static constexpr int kSize = 8;

  TexelBlocks() = default;
  // For targets of side x side texels. Unavailable: out of memory or context lost.
  [[nodiscard]] static Result<TexelBlocks> create(gl::Context& context, int side);
  // A program whose fragments are drawn by draw().
  [[nodiscard]] static Result<gl::Program> program(gl::Context& context,
                                                   std::span<const gl::ShaderFile> fragment,
                                                   std::span<const gl::Define> defines);

  // `mask`: side x side, not 0 where wanted.
  void set(std::span<const std::uint8_t> mask);
  // Of the blocks that set() has chosen.
  [[nodiscard]] std::size_t texels() const;
  void draw(gl::Program& program, gl::Framebuffer& target) const;

 private:
  struct Centre {
    float x, y;
  };
  int side_ = 0;
  bool whole_ = false;
  std::vector<Centre> chosen_;
  gl::Buffer centres_;
  gl::VertexArray points_;
};

}  // namespace overfly::tiling::detail
