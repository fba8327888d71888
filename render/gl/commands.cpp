#include "render/gl/commands.h"

#include <array>
#include <cstdint>
#include <stdexcept>
#include <utility>

#include "render/gl/detail/context_state.h"

namespace overfly::gl {
namespace {

GLbitfield barrierBits(Barrier barrier) {
  constexpr std::array<std::pair<Barrier, GLbitfield>, 8> kBits{{
      {Barrier::Storage, GL_SHADER_STORAGE_BARRIER_BIT},
      {Barrier::Image, GL_SHADER_IMAGE_ACCESS_BARRIER_BIT},
      {Barrier::TextureFetch, GL_TEXTURE_FETCH_BARRIER_BIT},
      {Barrier::Uniform, GL_UNIFORM_BARRIER_BIT},
      {Barrier::BufferUpdate, GL_BUFFER_UPDATE_BARRIER_BIT},
      {Barrier::TextureUpdate, GL_TEXTURE_UPDATE_BARRIER_BIT | GL_PIXEL_BUFFER_BARRIER_BIT},
      {Barrier::Framebuffer, GL_FRAMEBUFFER_BARRIER_BIT},
      {Barrier::Vertex, GL_VERTEX_ATTRIB_ARRAY_BARRIER_BIT | GL_ELEMENT_ARRAY_BARRIER_BIT},
  }};
  GLbitfield out = 0;
  for (const auto& [one, bits] : kBits) {
    if ((static_cast<unsigned>(barrier) & static_cast<unsigned>(one)) != 0) out |= bits;
  }
  return out;
}

void setEnabled(GLenum what, bool on) {
  if (on) {
    glEnable(what);
  } else {
    glDisable(what);
  }
}

void applyBlend(Blend blend) {
  setEnabled(GL_BLEND, blend != Blend::Off);
  glBlendEquation(GL_FUNC_ADD);
  switch (blend) {
    case Blend::Off:
      break;
    case Blend::Alpha:
      glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
      break;
    case Blend::Premultiplied:
      glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
      break;
    case Blend::Add:
      glBlendFunc(GL_ONE, GL_ONE);
      break;
    case Blend::Max:
      glBlendEquation(GL_MAX);
      break;
    case Blend::Min:
      glBlendEquation(GL_MIN);
      break;
  }
}

void apply(const Framebuffer& target, const DrawState& state) {
  const Rect view = state.viewport.value_or(Rect{0, 0, target.width(), target.height()});
  glViewport(view.x, view.y, view.width, view.height);
  setEnabled(GL_SCISSOR_TEST, state.scissor.has_value());
  if (state.scissor) {
    glScissor(state.scissor->x, state.scissor->y, state.scissor->width, state.scissor->height);
  }
  applyBlend(state.blend);
  setEnabled(GL_CULL_FACE, state.cull != Cull::Off);
  if (state.cull != Cull::Off) glCullFace(state.cull == Cull::Back ? GL_BACK : GL_FRONT);
  // GL writes depth only while the test is on.
  setEnabled(GL_DEPTH_TEST, state.depth_test || state.depth_write);
  glDepthFunc(state.depth_test ? GL_LESS : GL_ALWAYS);
  glDepthMask(state.depth_write ? GL_TRUE : GL_FALSE);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

GLenum mode(Topology topology) {
  switch (topology) {
    case Topology::Triangles:
      return GL_TRIANGLES;
    case Topology::TriangleStrip:
      return GL_TRIANGLE_STRIP;
    case Topology::Lines:
      return GL_LINES;
    case Topology::Points:
      return GL_POINTS;
  }
  return GL_TRIANGLES;
}

int groupsFor(int size, int group) { return (size + group - 1) / group; }

}  // namespace

void memoryBarrier(Context& context, Barrier barrier) {
  context.state()->bind();
  if (barrier != Barrier::None) glMemoryBarrier(barrierBits(barrier));
}

void dispatch(Program& program, int groups_x, int groups_y, int groups_z, Barrier after) {
  if (groups_x <= 0 || groups_y <= 0 || groups_z <= 0) return;
  program.use();
  glDispatchCompute(static_cast<GLuint>(groups_x), static_cast<GLuint>(groups_y),
                    static_cast<GLuint>(groups_z));
  if (after != Barrier::None) glMemoryBarrier(barrierBits(after));
}

void dispatchOver(Program& program, int width, int height, int depth, Barrier after) {
  const std::array<int, 3>& group = program.groupSize();
  if (group[0] <= 0) throw std::logic_error("dispatchOver of a program that is not a compute program");
  dispatch(program, groupsFor(width, group[0]), groupsFor(height, group[1]), groupsFor(depth, group[2]),
           after);
}

float largestPoint(const Context&) {
  std::array<float, 2> range{1, 1};
  glGetFloatv(GL_ALIASED_POINT_SIZE_RANGE, range.data());
  return range[1];
}

void drawFullScreen(Program& program, Framebuffer& target, const DrawState& state) {
  program.use();
  glBindFramebuffer(GL_FRAMEBUFFER, target.object().name());
  apply(target, state);
  glBindVertexArray(program.object().state().empty_vertex_array);
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

void draw(Program& program, Framebuffer& target, const VertexArray& vertices, int count, int instances,
          const DrawState& state, Topology topology, int first) {
  program.use();
  glBindFramebuffer(GL_FRAMEBUFFER, target.object().name());
  apply(target, state);
  glBindVertexArray(vertices.object().name());
  if (vertices.indexed()) {
    const void* offset = reinterpret_cast<const void*>(static_cast<std::uintptr_t>(first) * 4);
    glDrawElementsInstanced(mode(topology), count, GL_UNSIGNED_INT, offset, instances);
  } else {
    glDrawArraysInstanced(mode(topology), first, count, instances);
  }
  glBindVertexArray(0);
}

void resolve(const Framebuffer& from, Framebuffer& to) {
  glBindFramebuffer(GL_READ_FRAMEBUFFER, from.object().name());
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, to.object().name());
  glDisable(GL_SCISSOR_TEST);
  glBlitFramebuffer(0, 0, from.width(), from.height(), 0, 0, to.width(), to.height(), GL_COLOR_BUFFER_BIT,
                    GL_NEAREST);
  glBindFramebuffer(GL_FRAMEBUFFER, to.object().name());
}

}  // namespace overfly::gl
