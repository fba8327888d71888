#include "render/gl/framebuffer.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <stdexcept>

#include "render/gl/detail/context_state.h"

namespace overfly::gl {
namespace {

void attach(GLenum point, const Attachment& attachment) {
  const GLuint name = attachment.texture->object().name();
  if (attachment.texture->spec().samples > 0) {
    glFramebufferTexture2D(GL_FRAMEBUFFER, point, GL_TEXTURE_2D_MULTISAMPLE, name, 0);
  } else if (attachment.texture->spec().layers > 0) {
    glFramebufferTextureLayer(GL_FRAMEBUFFER, point, name, attachment.level, attachment.layer);
  } else {
    glFramebufferTexture2D(GL_FRAMEBUFFER, point, GL_TEXTURE_2D, name, attachment.level);
  }
}

std::string formatList(std::span<const Attachment> color, const Attachment& depth) {
  std::string out;
  for (const Attachment& one : color) {
    if (!out.empty()) out += ", ";
    out += formatName(one.texture->spec().format);
  }
  if (depth.texture != nullptr) out += fmt::format(" with {}", formatName(depth.texture->spec().format));
  return out;
}

}  // namespace

Result<Framebuffer> Framebuffer::create(Context& context, std::span<const Attachment> color,
                                        const Attachment& depth) {
  detail::ContextState& state = *context.state();
  if (color.empty() && depth.texture == nullptr) throw std::logic_error("a framebuffer without attachments");
  state.bind();
  GLuint name = 0;
  glGenFramebuffers(1, &name);
  Framebuffer out;
  out.object_ = detail::Object(context.state(), detail::ObjectKind::Framebuffer, name);
  glBindFramebuffer(GL_FRAMEBUFFER, name);
  std::vector<GLenum> buffers;
  const Attachment& first = color.empty() ? depth : color.front();
  out.width_ = first.texture->width(first.level);
  out.height_ = first.texture->height(first.level);
  for (const Attachment& one : color) {
    const GLenum point = GL_COLOR_ATTACHMENT0 + static_cast<GLenum>(buffers.size());
    attach(point, one);
    buffers.push_back(point);
    out.width_ = std::min(out.width_, one.texture->width(one.level));
    out.height_ = std::min(out.height_, one.texture->height(one.level));
  }
  if (depth.texture != nullptr) attach(GL_DEPTH_ATTACHMENT, depth);
  glDrawBuffers(static_cast<GLsizei>(buffers.size()), buffers.data());
  const GLenum status = glCheckFramebufferStatus(GL_FRAMEBUFFER);
  if (auto made = state.outcome("Creating a framebuffer"); !made) return tl::unexpected(made.error());
  if (status != GL_FRAMEBUFFER_COMPLETE) {
    return fail(ErrorCode::Unsupported, fmt::format("This GPU cannot render into {} (status 0x{:x}).",
                                                    formatList(color, depth), status));
  }
  return out;
}

void Framebuffer::clearColor(int index, float r, float g, float b, float a) {
  glBindFramebuffer(GL_FRAMEBUFFER, object_.name());
  glDisable(GL_SCISSOR_TEST);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  const std::array<float, 4> value{r, g, b, a};
  glClearBufferfv(GL_COLOR, index, value.data());
}

void Framebuffer::clearColorUint(int index, unsigned r, unsigned g, unsigned b, unsigned a) {
  glBindFramebuffer(GL_FRAMEBUFFER, object_.name());
  glDisable(GL_SCISSOR_TEST);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  const std::array<GLuint, 4> value{r, g, b, a};
  glClearBufferuiv(GL_COLOR, index, value.data());
}

void Framebuffer::clearColorInt(int index, int r, int g, int b, int a) {
  glBindFramebuffer(GL_FRAMEBUFFER, object_.name());
  glDisable(GL_SCISSOR_TEST);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  const std::array<GLint, 4> value{r, g, b, a};
  glClearBufferiv(GL_COLOR, index, value.data());
}

void Framebuffer::clearDepth(float depth) {
  glBindFramebuffer(GL_FRAMEBUFFER, object_.name());
  glDisable(GL_SCISSOR_TEST);
  glDepthMask(GL_TRUE);
  glClearBufferfv(GL_DEPTH, 0, &depth);
}

}  // namespace overfly::gl
