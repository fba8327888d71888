#include "tiling/rectify/rectifier.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <string>

#include "capture/image_decode.h"
#include "rectify_shaders.h"

namespace overfly::tiling {
namespace {

using capture::Image;
using capture::PixelFormat;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kMaps = 4;  // a flight has one camera, seldom two
constexpr int kBlock = 32;        // pixels, of the statistics

double secondsSince(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

// The texture, made anew when it is not of this format and size.
Result<void> ensure(gl::Context& context, gl::Texture& texture, gl::Format format, int width, int height) {
  if (!texture.empty() && texture.spec().format == format && texture.width() == width &&
      texture.height() == height) {
    return {};
  }
  gl::TextureSpec spec{format, width, height};
  spec.sampling = {gl::Filter::Nearest, gl::Filter::Nearest};
  auto made = gl::Texture::create(context, spec);
  if (!made) return tl::unexpected(made.error());
  texture = std::move(*made);
  return {};
}

// Rows of `channels` bytes a pixel; a stride that is no whole number of pixels is packed first.
void uploadRows(gl::Texture& texture, std::span<const std::uint8_t> bytes, int stride, int channels) {
  if (stride % channels == 0) {
    texture.upload(bytes, 0, 0, stride / channels);
    return;
  }
  const auto row = static_cast<std::size_t>(texture.width() * channels);
  std::vector<std::uint8_t> packed;
  packed.reserve(row * static_cast<std::size_t>(texture.height()));
  for (int y = 0; y < texture.height(); ++y) {
    const auto line = bytes.subspan(static_cast<std::size_t>(y) * static_cast<std::size_t>(stride), row);
    packed.insert(packed.end(), line.begin(), line.end());
  }
  texture.upload(std::span<const std::uint8_t>(packed));
}

int sourceKind(PixelFormat format) {  // SOURCE_* of rectify.frag
  switch (format) {
    case PixelFormat::Grey8:
      return 0;
    case PixelFormat::Bgr8:
      return 2;
    case PixelFormat::Nv12:
      return 3;
    case PixelFormat::Rgb8:
    case PixelFormat::Jpeg:  // decoded to Rgb8
      return 1;
  }
  return 1;
}

}  // namespace

Result<Rectifier> Rectifier::create(gl::Context& context, const RectifyOptions& options) {
  Rectifier out(context, options);
  out.options_.undistortion.max_side =
      std::min(options.undistortion.max_side, context.info().limits.texture_size);
  const gl::ShaderFile quads{"pack_quads.frag", shaders::rectify::pack_quads_frag};
  auto pack = gl::Program::fullScreen(context, {&quads, 1});
  if (!pack) return tl::unexpected(pack.error());
  out.pack_quads_ = std::move(*pack);
  const gl::ShaderFile stats{"luma_stats.comp", shaders::rectify::luma_stats_comp};
  const gl::Define block{"BLOCK", std::to_string(kBlock)};
  auto sums = gl::Program::compute(context, {&stats, 1}, {&block, 1});
  if (!sums) return tl::unexpected(sums.error());
  out.luma_stats_ = std::move(*sums);
  return out;
}

Result<gl::Program*> Rectifier::programOf(PixelFormat format) {
  const auto known = programs_.find(format);
  if (known != programs_.end()) return &known->second;
  const gl::ShaderFile file{"rectify.frag", shaders::rectify::rectify_frag};
  const gl::Define source{"SOURCE", std::to_string(sourceKind(format))};
  auto made = gl::Program::fullScreen(*context_, {&file, 1}, {&source, 1});
  if (!made) return tl::unexpected(made.error());
  return &programs_.emplace(format, std::move(*made)).first->second;
}

Result<Rectifier::Map*> Rectifier::mapOf(const capture::CameraModel& camera) {
  for (Map& map : maps_) {
    if (map.camera == camera) return &map;
  }
  auto plan = planUndistortion(camera, options_.undistortion);
  if (!plan) return tl::unexpected(plan.error());
  Map map{camera, plan->pinhole, plan->step, {}};
  if (auto made = ensure(*context_, map.grid, gl::Format::RG32F, plan->nodes_x, plan->nodes_y); !made) {
    return tl::unexpected(made.error());
  }
  map.grid.upload(std::span<const float>(plan->shift));
  if (maps_.size() == kMaps) maps_.pop_back();
  maps_.push_front(std::move(map));
  return &maps_.front();
}

Result<void> Rectifier::upload(const Image& image) {
  const std::span<const std::uint8_t> bytes(image.bytes);
  const bool planar = image.format == PixelFormat::Grey8 || image.format == PixelFormat::Nv12;
  const gl::Format format = planar ? gl::Format::R8 : gl::Format::RGB8;
  if (auto made = ensure(*context_, plane0_, format, image.width, image.height); !made) return made;
  uploadRows(plane0_, bytes, image.stride, planar ? 1 : 3);
  if (image.format == PixelFormat::Nv12) {
    if (auto made =
            ensure(*context_, plane1_, gl::Format::RG8, (image.width + 1) / 2, (image.height + 1) / 2);
        !made) {
      return made;
    }
    uploadRows(plane1_,
               bytes.subspan(static_cast<std::size_t>(image.stride) * static_cast<std::size_t>(image.height)),
               image.stride, 2);
  }
  return {};
}

Result<RectifiedFrame> Rectifier::rectify(std::uint64_t id, const capture::Frame& frame) {
  const auto map = mapOf(frame.camera);
  if (!map) return tl::unexpected(map.error());
  if (const auto problem = capture::problemOf(frame.image)) return fail(ErrorCode::BadInput, *problem);
  RectifiedFrame out;
  out.id = id;
  out.camera = frame.camera;
  out.pinhole = (*map)->pinhole;

  auto begin = Clock::now();
  const Image* image = &frame.image;
  Result<Image> decoded;
  if (image->format == PixelFormat::Jpeg) {
    decoded = capture::decodeImage(*image, PixelFormat::Rgb8);
    if (!decoded) return tl::unexpected(decoded.error());
    image = &*decoded;
  }
  out.times.decode_s = secondsSince(begin);
  if (image->width != frame.camera.width || image->height != frame.camera.height) {
    return fail(ErrorCode::BadInput,
                fmt::format("the image of frame {} has {}x{} pixels, its camera model {}x{}", frame.name,
                            image->width, image->height, frame.camera.width, frame.camera.height));
  }
  begin = Clock::now();
  if (auto done = upload(*image); !done) return tl::unexpected(done.error());
  out.times.upload_s = secondsSince(begin);

  begin = Clock::now();
  const auto program = programOf(image->format);
  if (!program) return tl::unexpected(program.error());
  auto color = gl::Texture::create(*context_, {gl::Format::RGBA8, out.pinhole.width, out.pinhole.height});
  if (!color) return tl::unexpected(color.error());
  gl::TextureSpec luma_spec{gl::Format::R8, out.pinhole.width, out.pinhole.height, 0, gl::kFullChain};
  luma_spec.sampling.between_levels = true;
  auto luma = gl::Texture::create(*context_, luma_spec);
  if (!luma) return tl::unexpected(luma.error());
  out.color = std::move(*color);
  out.luma = std::move(*luma);
  const std::array<gl::Attachment, 2> targets{gl::Attachment{&out.color}, gl::Attachment{&out.luma}};
  auto framebuffer = gl::Framebuffer::create(*context_, targets);
  if (!framebuffer) return tl::unexpected(framebuffer.error());
  gl::Program& draw = **program;
  draw.setTexture("shift_grid", 1, (*map)->grid);
  draw.setTexture("plane0", 2, plane0_);
  if (image->format == PixelFormat::Nv12) draw.setTexture("plane1", 3, plane1_);
  draw.set("grid_step", static_cast<float>((*map)->step));
  draw.set("source_size", Eigen::Vector2i(image->width, image->height));
  gl::drawFullScreen(draw, *framebuffer);
  out.luma.generateMips();
  if (options_.quads) {
    if (auto done = packQuads(out); !done) return tl::unexpected(done.error());
  }
  auto stats = statsOf(out);
  if (!stats) return tl::unexpected(stats.error());
  out.stats = *stats;
  out.times.gpu_s = secondsSince(begin);
  return out;
}

Result<void> Rectifier::packQuads(RectifiedFrame& frame) {
  gl::TextureSpec spec{gl::Format::RGBA8, frame.luma.width(), frame.luma.height(), 0, gl::kFullChain};
  spec.sampling = {gl::Filter::Nearest, gl::Filter::Nearest};
  auto made = gl::Texture::create(*context_, spec);
  if (!made) return tl::unexpected(made.error());
  frame.quads = std::move(*made);
  pack_quads_.setTexture("luma", 1, frame.luma);
  for (int level = 0; level < frame.quads.spec().levels; ++level) {
    const gl::Attachment target{&frame.quads, level};
    auto framebuffer = gl::Framebuffer::create(*context_, {&target, 1});
    if (!framebuffer) return tl::unexpected(framebuffer.error());
    pack_quads_.set("level", level);
    gl::drawFullScreen(pack_quads_, *framebuffer);
  }
  return {};
}

Result<LumaStats> Rectifier::statsOf(const RectifiedFrame& frame) {
  const int blocks_x = (frame.luma.width() + kBlock - 1) / kBlock;
  const int blocks_y = (frame.luma.height() + kBlock - 1) / kBlock;
  std::vector<std::array<float, 4>> sums(static_cast<std::size_t>(blocks_x) *
                                         static_cast<std::size_t>(blocks_y));
  auto buffer = gl::Buffer::create(*context_, sums.size() * sizeof(sums[0]), gl::BufferUse::ReadBack);
  if (!buffer) return tl::unexpected(buffer.error());
  buffer->bindStorage(0);
  luma_stats_.setTexture("color", 1, frame.color);
  luma_stats_.setTexture("luma", 2, frame.luma);
  luma_stats_.set("blocks", Eigen::Vector2i(blocks_x, blocks_y));
  gl::dispatchOver(luma_stats_, blocks_x, blocks_y, 1, gl::Barrier::BufferUpdate);
  if (auto done = buffer->download(std::span(sums)); !done) return tl::unexpected(done.error());
  Eigen::Vector4d total = Eigen::Vector4d::Zero();
  for (const auto& sum : sums) total += Eigen::Map<const Eigen::Vector4f>(sum.data()).cast<double>();
  LumaStats out;
  // Every second pixel of every second row was counted.
  out.valid = 4 * total[0] / (static_cast<double>(frame.luma.width()) * frame.luma.height());
  out.valid = std::min(out.valid, 1.0);
  if (total[0] > 0) {
    out.mean = total[1] / total[0];
    out.deviation = std::sqrt(std::max(0.0, total[2] / total[0] - out.mean * out.mean));
    out.sharpness = std::sqrt(total[3] / total[0]);
  }
  return out;
}

}  // namespace overfly::tiling
