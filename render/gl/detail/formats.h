#pragma once
#include "render/gl/detail/gl_api.h"
#include "render/gl/format.h"

namespace overfly::gl::detail {

struct FormatRow {
  Format format;
  const char* name;
  GLenum internal;
  GLenum external;  // client format of the texel's own channels
  GLenum type;      // client type of one channel
  int channels;
  int bytes;
  bool portable_image;
};
[[nodiscard]] const FormatRow& row(Format format);
[[nodiscard]] constexpr bool isInteger(GLenum external) {
  return external == GL_RED_INTEGER || external == GL_RG_INTEGER || external == GL_RGBA_INTEGER;
}
[[nodiscard]] constexpr bool isDepth(Format format) {
  return format == Format::Depth24 || format == Format::Depth32F;
}

}  // namespace overfly::gl::detail
