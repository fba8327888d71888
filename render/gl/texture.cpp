#include "render/gl/texture.h"

#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <stdexcept>
#include <vector>

#include "render/gl/detail/context_state.h"
#include "render/gl/detail/formats.h"

namespace overfly::gl {
namespace {

GLenum target(const TextureSpec& spec) {
  if (spec.samples > 0) return GL_TEXTURE_2D_MULTISAMPLE;
  return spec.layers > 0 ? GL_TEXTURE_2D_ARRAY : GL_TEXTURE_2D;
}

GLenum glWrap(Wrap wrap) {
  switch (wrap) {
    case Wrap::Clamp:
      return GL_CLAMP_TO_EDGE;
    case Wrap::Repeat:
      return GL_REPEAT;
    case Wrap::MirroredRepeat:
      return GL_MIRRORED_REPEAT;
  }
  return GL_CLAMP_TO_EDGE;
}

GLenum minifier(const Sampling& sampling, bool mipped) {
  const bool linear = sampling.minify == Filter::Linear;
  if (!mipped) return linear ? GL_LINEAR : GL_NEAREST;
  if (sampling.between_levels) return linear ? GL_LINEAR_MIPMAP_LINEAR : GL_NEAREST_MIPMAP_LINEAR;
  return linear ? GL_LINEAR_MIPMAP_NEAREST : GL_NEAREST_MIPMAP_NEAREST;
}

std::size_t componentBytes(Component component) {
  switch (component) {
    case Component::U8:
      return 1;
    case Component::U16:
      return 2;
    default:
      return 4;
  }
}

GLenum glType(Component component, const detail::FormatRow& row) {
  switch (component) {
    case Component::U8:
      return GL_UNSIGNED_BYTE;
    case Component::U16:
      return row.type == GL_HALF_FLOAT ? GL_HALF_FLOAT : GL_UNSIGNED_SHORT;
    case Component::U32:
      return GL_UNSIGNED_INT;
    case Component::I32:
      return GL_INT;
    case Component::F32:
      return GL_FLOAT;
  }
  return GL_FLOAT;
}

bool uploadFits(GLenum type, const detail::FormatRow& row) {
  return type == row.type || (type == GL_FLOAT && row.type == GL_HALF_FLOAT);
}

bool downloadFits(GLenum type, const detail::FormatRow& row) {
  return row.type == GL_HALF_FLOAT ? type == GL_FLOAT : type == row.type;
}

void require(bool holds, const char* what, const TextureSpec& spec) {
  if (!holds) throw std::logic_error(fmt::format("GL texture ({}): {}", formatName(spec.format), what));
}

bool inside(const Rect& rect, int width, int height) {
  return rect.x >= 0 && rect.y >= 0 && rect.width >= 0 && rect.height >= 0 && rect.x + rect.width <= width &&
         rect.y + rect.height <= height;
}

// The pair of format and type that glReadPixels promises for every framebuffer of this kind.
struct ReadForm {
  GLenum format;
  GLenum type;
  int channels;
};

ReadForm promisedReadForm(const detail::FormatRow& row) {
  if (row.external == GL_RED_INTEGER || row.external == GL_RG_INTEGER || row.external == GL_RGBA_INTEGER) {
    return {GL_RGBA_INTEGER, static_cast<GLenum>(row.type == GL_INT ? GL_INT : GL_UNSIGNED_INT), 4};
  }
  if (row.type == GL_UNSIGNED_BYTE) return {GL_RGBA, GL_UNSIGNED_BYTE, 4};
  return {GL_RGBA, GL_FLOAT, 4};
}

// Keeps the first `channels` of four, narrowing wide integers to the component wanted.
void pack(const std::vector<std::byte>& rgba, GLenum type, int channels, Component component,
          std::span<std::byte> out) {
  const std::size_t in_bytes = type == GL_UNSIGNED_BYTE ? 1 : 4;
  const std::size_t out_bytes = componentBytes(component);
  const std::size_t count = rgba.size() / (4 * in_bytes);
  // Little-endian: the low bytes of a wide integer come first.
  static_assert(std::endian::native == std::endian::little);
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t c = 0; c < static_cast<std::size_t>(channels); ++c) {
      std::memcpy(&out[(i * static_cast<std::size_t>(channels) + c) * out_bytes],
                  &rgba[(i * 4 + c) * in_bytes], out_bytes);
    }
  }
}

}  // namespace

int fullChainLevels(int width, int height) {
  return static_cast<int>(std::bit_width(static_cast<unsigned>(std::max({width, height, 1}))));
}

Result<Texture> Texture::create(Context& context, const TextureSpec& wanted) {
  detail::ContextState& state = *context.state();
  state.collectErrors();
  state.out_of_memory = false;
  Texture out;
  out.spec_ = wanted;
  TextureSpec& spec = out.spec_;
  require(spec.width > 0 && spec.height > 0 && spec.layers >= 0 && spec.levels >= 0, "empty size", spec);
  if (spec.levels == kFullChain) spec.levels = fullChainLevels(spec.width, spec.height);
  const Limits& limits = state.info.limits;
  if (std::max(spec.width, spec.height) > limits.texture_size || spec.layers > limits.texture_layers) {
    return fail(
        ErrorCode::Unsupported,
        fmt::format("A texture of {}x{}x{} is beyond this GPU's limit of {}x{}x{}.", spec.width, spec.height,
                    spec.layers, limits.texture_size, limits.texture_size, limits.texture_layers));
  }
  GLuint name = 0;
  glGenTextures(1, &name);
  out.object_ = detail::Object(context.state(), detail::ObjectKind::Texture, name);
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(target(spec), name);
  const detail::FormatRow& row = detail::row(spec.format);
  require(spec.samples == 0 || (spec.layers == 0 && spec.levels == 1), "multi-sampled with layers or levels",
          spec);
  if (spec.samples > 0) {
    glTexStorage2DMultisample(GL_TEXTURE_2D_MULTISAMPLE, spec.samples, row.internal, spec.width, spec.height,
                              GL_TRUE);
  } else if (spec.layers > 0) {
    glTexStorage3D(GL_TEXTURE_2D_ARRAY, spec.levels, row.internal, spec.width, spec.height, spec.layers);
  } else {
    glTexStorage2D(GL_TEXTURE_2D, spec.levels, row.internal, spec.width, spec.height);
  }
  if (auto made = state.outcome("Creating a texture"); !made) return tl::unexpected(made.error());
  if (spec.samples > 0) return out;  // has no sampling state
  Sampling sampling = spec.sampling;
  if (!state.info.support(spec.format).filterable) {
    sampling.magnify = Filter::Nearest;
    sampling.minify = Filter::Nearest;
    sampling.between_levels = false;
  }
  out.setSampling(sampling);
  return out;
}

int Texture::width(int level) const { return std::max(1, spec_.width >> level); }
int Texture::height(int level) const { return std::max(1, spec_.height >> level); }

std::size_t Texture::bytes() const {
  if (empty()) return 0;
  std::size_t texels = 0;
  for (int level = 0; level < spec_.levels; ++level) {
    texels += static_cast<std::size_t>(width(level)) * static_cast<std::size_t>(height(level));
  }
  return texels * bytesPerTexel(spec_.format) * static_cast<std::size_t>(std::max(1, spec_.layers));
}

void Texture::setSampling(const Sampling& sampling) {
  spec_.sampling = sampling;
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(target(spec_), object_.name());
  const auto set = [&](GLenum what, GLenum value) {
    glTexParameteri(target(spec_), what, static_cast<GLint>(value));
  };
  set(GL_TEXTURE_MAG_FILTER, sampling.magnify == Filter::Linear ? GL_LINEAR : GL_NEAREST);
  set(GL_TEXTURE_MIN_FILTER, minifier(sampling, spec_.levels > 1));
  set(GL_TEXTURE_WRAP_S, glWrap(sampling.wrap));
  set(GL_TEXTURE_WRAP_T, glWrap(sampling.wrap));
}

void Texture::setLevelRange(int first, int last) {
  require(first >= 0 && last >= first && last < spec_.levels, "no such mip levels", spec_);
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(target(spec_), object_.name());
  glTexParameteri(target(spec_), GL_TEXTURE_BASE_LEVEL, first);
  glTexParameteri(target(spec_), GL_TEXTURE_MAX_LEVEL, last);
}

void Texture::uploadBytes(std::span<const std::byte> texels, Component component, const Rect& rect, int level,
                          int layer, int row_stride) {
  const detail::FormatRow& row = detail::row(spec_.format);
  const GLenum type = glType(component, row);
  require(uploadFits(type, row), "component type does not fit the format", spec_);
  require(level >= 0 && level < spec_.levels, "no such mip level", spec_);
  require(layer >= 0 && layer < std::max(1, spec_.layers), "no such layer", spec_);
  require(inside(rect, width(level), height(level)), "upload outside the level", spec_);
  if (rect.width == 0 || rect.height == 0) return;
  const int stride = row_stride > 0 ? row_stride : rect.width;
  const std::size_t texel = static_cast<std::size_t>(row.channels) * componentBytes(component);
  const std::size_t needed = (static_cast<std::size_t>(stride) * static_cast<std::size_t>(rect.height - 1) +
                              static_cast<std::size_t>(rect.width)) *
                             texel;
  require(stride >= rect.width && texels.size() >= needed, "too few texels given", spec_);
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(target(spec_), object_.name());
  glPixelStorei(GL_UNPACK_ROW_LENGTH, row_stride > 0 ? row_stride : 0);
  if (spec_.layers > 0) {
    glTexSubImage3D(GL_TEXTURE_2D_ARRAY, level, rect.x, rect.y, layer, rect.width, rect.height, 1,
                    row.external, type, texels.data());
  } else {
    glTexSubImage2D(GL_TEXTURE_2D, level, rect.x, rect.y, rect.width, rect.height, row.external, type,
                    texels.data());
  }
  glPixelStorei(GL_UNPACK_ROW_LENGTH, 0);
}

Result<void> Texture::downloadBytes(std::span<std::byte> texels, Component component, const Rect& rect,
                                    int level, int layer) const {
  const detail::FormatRow& row = detail::row(spec_.format);
  const GLenum type = glType(component, row);
  require(downloadFits(type, row), "component type does not fit the format", spec_);
  require(level >= 0 && level < spec_.levels, "no such mip level", spec_);
  require(inside(rect, width(level), height(level)), "download outside the level", spec_);
  const std::size_t count = static_cast<std::size_t>(rect.width) * static_cast<std::size_t>(rect.height);
  require(texels.size() >= count * static_cast<std::size_t>(row.channels) * componentBytes(component),
          "too little room for a download", spec_);
  detail::ContextState& state = object_.state();
  const GLuint name = object_.name();
  if (!state.info.support(spec_.format).renderable || detail::isDepth(spec_.format)) {
    return fail(ErrorCode::Unsupported,
                fmt::format("Textures of format {} cannot be read back on this GPU.", row.name));
  }
  GLint previous = 0;
  glGetIntegerv(GL_READ_FRAMEBUFFER_BINDING, &previous);
  GLuint framebuffer = 0;
  glGenFramebuffers(1, &framebuffer);
  glBindFramebuffer(GL_READ_FRAMEBUFFER, framebuffer);
  if (spec_.layers > 0) {
    glFramebufferTextureLayer(GL_READ_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, name, level, layer);
  } else {
    glFramebufferTexture2D(GL_READ_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, name, level);
  }
  glMemoryBarrier(GL_FRAMEBUFFER_BARRIER_BIT);
  GLint offered_format = 0, offered_type = 0;
  glGetIntegerv(GL_IMPLEMENTATION_COLOR_READ_FORMAT, &offered_format);
  glGetIntegerv(GL_IMPLEMENTATION_COLOR_READ_TYPE, &offered_type);
  const ReadForm promised = promisedReadForm(row);
  const bool direct =
      (static_cast<GLenum>(offered_format) == row.external && static_cast<GLenum>(offered_type) == type) ||
      (promised.format == row.external && promised.type == type);
  if (direct) {
    glReadPixels(rect.x, rect.y, rect.width, rect.height, row.external, type, texels.data());
  } else {
    std::vector<std::byte> rgba(count * 4 * (promised.type == GL_UNSIGNED_BYTE ? 1 : 4));
    glReadPixels(rect.x, rect.y, rect.width, rect.height, promised.format, promised.type, rgba.data());
    pack(rgba, promised.type, row.channels, component, texels);
  }
  glBindFramebuffer(GL_READ_FRAMEBUFFER, static_cast<GLuint>(previous));
  glDeleteFramebuffers(1, &framebuffer);
  return state.outcome("Reading a texture");
}

void Texture::generateMips() {
  glActiveTexture(GL_TEXTURE0);
  glBindTexture(target(spec_), object_.name());
  glMemoryBarrier(GL_TEXTURE_UPDATE_BARRIER_BIT);
  glGenerateMipmap(target(spec_));
}

void Texture::bind(int unit) const {
  const GLuint name = object_.name();
  glActiveTexture(GL_TEXTURE0 + static_cast<GLenum>(unit));
  glBindTexture(target(spec_), name);
}

void Texture::bindImage(int unit, ImageAccess access, int level, int layer) const {
  const GLenum mode = access == ImageAccess::Read    ? GL_READ_ONLY
                      : access == ImageAccess::Write ? GL_WRITE_ONLY
                                                     : GL_READ_WRITE;
  glBindImageTexture(static_cast<GLuint>(unit), object_.name(), level,
                     static_cast<GLboolean>(layer < 0 ? GL_TRUE : GL_FALSE), layer < 0 ? 0 : layer, mode,
                     detail::row(spec_.format).internal);
}

}  // namespace overfly::gl
