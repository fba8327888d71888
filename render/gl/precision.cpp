#include "render/gl/precision.h"

#include <array>
#include <cstdint>

#include "gl_shaders.h"
#include "render/gl/commands.h"

namespace overfly::gl {

Result<Precision> probePrecision(Context& context) {
  const ShaderFile common{"precision.glsl", shaders::gl::precision_glsl};
  const std::array<ShaderFile, 2> compute_files{common, {"precision.comp", shaders::gl::precision_comp}};
  const std::array<ShaderFile, 2> fragment_files{common, {"precision.frag", shaders::gl::precision_frag}};
  Precision out;

  auto compute = Program::compute(context, compute_files);
  if (!compute) return tl::unexpected(compute.error());
  auto buffer = Buffer::create(context, sizeof(float), BufferUse::ReadBack);
  if (!buffer) return tl::unexpected(buffer.error());
  compute->set("one", 1.0F);
  buffer->bindStorage(0);
  dispatch(*compute, 1);
  std::array<float, 1> bits{};
  if (auto done = buffer->download(std::span<float>(bits)); !done) return tl::unexpected(done.error());
  out.compute_bits = static_cast<int>(bits[0]);

  auto fragment = Program::fullScreen(context, fragment_files);
  if (!fragment) return tl::unexpected(fragment.error());
  auto target = Texture::create(context, {Format::RGBA8, 1, 1});
  if (!target) return tl::unexpected(target.error());
  auto framebuffer = Framebuffer::create(context, *target);
  if (!framebuffer) return tl::unexpected(framebuffer.error());
  fragment->set("one", 1.0F);
  drawFullScreen(*fragment, *framebuffer);
  std::array<std::uint8_t, 4> texel{};
  if (auto done = target->download(std::span<std::uint8_t>(texel)); !done)
    return tl::unexpected(done.error());
  out.fragment_bits = texel[0];
  return out;
}

}  // namespace overfly::gl
