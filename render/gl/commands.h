#pragma once
#include <optional>

#include "render/gl/framebuffer.h"
#include "render/gl/program.h"
#include "render/gl/vertex_array.h"

namespace overfly::gl {

// What must be finished and visible before what follows (glMemoryBarrier); combine with |. After image or
// storage writes of a shader, name how the result is read next.
enum class Barrier : unsigned {
  None = 0,
  Storage = 1u << 0,       // read or written as SSBO next
  Image = 1u << 1,         // imageLoad/imageStore next
  TextureFetch = 1u << 2,  // sampled next
  Uniform = 1u << 3,
  BufferUpdate = 1u << 4,   // buffer upload or download next
  TextureUpdate = 1u << 5,  // texture upload or download next
  Framebuffer = 1u << 6,    // rendered into or read back next
  Vertex = 1u << 7,         // read as vertices or indices next
  All = 0xFFu,
};
[[nodiscard]] constexpr Barrier operator|(Barrier a, Barrier b) {
  return static_cast<Barrier>(static_cast<unsigned>(a) | static_cast<unsigned>(b));
}
void memoryBarrier(Context& context, Barrier barrier);

// Runs `groups` work groups, then the barrier.
void dispatch(Program& program, int groups_x, int groups_y = 1, int groups_z = 1,
              Barrier after = Barrier::All);
// As many work groups as cover `width` x `height` (x `depth`) invocations: the shader must cut off the rest.
void dispatchOver(Program& program, int width, int height, int depth = 1, Barrier after = Barrier::All);

// Texels across the largest point that draw() can make here; OpenGL ES promises 1.
[[nodiscard]] float largestPoint(const Context& context);

enum class Blend { Off, Alpha, Premultiplied, Add, Max, Min };
enum class Cull { Off, Back, Front };
enum class Topology { Triangles, TriangleStrip, Lines, Points };

// All fixed state of a draw; nothing is carried over from earlier draws.
struct DrawState {
  std::optional<Rect> viewport;  // absent: the whole framebuffer
  std::optional<Rect> scissor;
  Blend blend = Blend::Off;
  Cull cull = Cull::Off;
  bool depth_test = false;  // less
  bool depth_write = false;
};

// One fragment per texel of the viewport, by a program of Program::fullScreen.
void drawFullScreen(Program& program, Framebuffer& target, const DrawState& state = {});

// `count` vertices (or indices) from `first` on, `instances` times.
void draw(Program& program, Framebuffer& target, const VertexArray& vertices, int count, int instances = 1,
          const DrawState& state = {}, Topology topology = Topology::Triangles, int first = 0);

// Averages the samples of the first colour target of `from` into that of `to`, of the same size and format.
void resolve(const Framebuffer& from, Framebuffer& to);

}  // namespace overfly::gl
