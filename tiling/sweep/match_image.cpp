#include "tiling/sweep/match_image.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "render/gl/commands.h"
#include "render/gl/framebuffer.h"
#include "render/gl/program.h"
#include "sweep_shaders.h"

namespace overfly::tiling {

struct MatchImageMaker::Impl {
  gl::Context* context;
  MatchImageOptions options;
  gl::Program mean;
  gl::Program norm;
};

MatchImageMaker::MatchImageMaker(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
MatchImageMaker::~MatchImageMaker() = default;

Result<std::unique_ptr<MatchImageMaker>> MatchImageMaker::create(gl::Context& context,
                                                                 const MatchImageOptions& options) {
  auto impl = std::make_unique<Impl>();
  impl->context = &context;
  impl->options = options;
  const std::array defines{gl::Define{"RADIUS", std::to_string(options.radius)},
                           gl::Define{"CODE_SCALE", "42.0"}};
  const std::array mean_files{gl::ShaderFile{"local_mean.frag", shaders::sweep::local_mean_frag}};
  const std::array norm_files{gl::ShaderFile{"local_norm.frag", shaders::sweep::local_norm_frag}};
  auto mean = gl::Program::fullScreen(context, mean_files, defines);
  if (!mean) return tl::unexpected(mean.error());
  auto norm = gl::Program::fullScreen(context, norm_files, defines);
  if (!norm) return tl::unexpected(norm.error());
  impl->mean = std::move(*mean);
  impl->norm = std::move(*norm);
  return std::unique_ptr<MatchImageMaker>(new MatchImageMaker(std::move(impl)));
}

Result<gl::Texture> MatchImageMaker::make(const gl::Texture& luma, const gl::Texture& color) {
  gl::Context& context = *impl_->context;
  const int levels = std::min(impl_->options.levels, luma.spec().levels);
  auto match = gl::Texture::create(context, {.format = gl::Format::R8,
                                             .width = luma.width(),
                                             .height = luma.height(),
                                             .levels = levels,
                                             .sampling = {.between_levels = false}});
  if (!match) return match;
  for (int level = 0; level < levels; ++level) {
    auto moments = gl::Texture::create(context, {.format = gl::Format::RG32F,
                                                 .width = luma.width(level),
                                                 .height = luma.height(level),
                                                 .sampling = {gl::Filter::Nearest, gl::Filter::Nearest}});
    if (!moments) return moments;
    auto rows = gl::Framebuffer::create(context, *moments);
    if (!rows) return tl::unexpected(rows.error());
    impl_->mean.setTexture("luma", 0, luma);
    impl_->mean.set("level", level);
    gl::drawFullScreen(impl_->mean, *rows);

    const gl::Attachment target{&*match, level, 0};
    auto columns = gl::Framebuffer::create(context, std::span<const gl::Attachment>(&target, 1));
    if (!columns) return tl::unexpected(columns.error());
    impl_->norm.setTexture("luma", 0, luma);
    impl_->norm.setTexture("moments", 1, *moments);
    impl_->norm.setTexture("color", 2, color);
    impl_->norm.set("level", level);
    impl_->norm.set("noise", static_cast<float>(impl_->options.noise / 255.0));
    gl::drawFullScreen(impl_->norm, *columns);
  }
  return match;
}

}  // namespace overfly::tiling
