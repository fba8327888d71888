#include "tiling/sweep/detail/texel_blocks.h"

#include <algorithm>
#include <array>
#include <string>

#include "render/gl/commands.h"
#include "sweep_shaders.h"

namespace overfly::tiling::detail {
namespace {

bool drawsBlocks(const gl::Context& context) { return gl::largestPoint(context) >= TexelBlocks::kSize; }

}  // namespace

Result<TexelBlocks> TexelBlocks::create(gl::Context& context, int side) {
  TexelBlocks blocks;
  blocks.side_ = side;
  blocks.whole_ = !drawsBlocks(context);
  const auto along = static_cast<std::size_t>((side + kSize - 1) / kSize);
  auto buffer = gl::Buffer::create(context, along * along * sizeof(Centre));
  if (!buffer) return tl::unexpected(buffer.error());
  blocks.centres_ = std::move(*buffer);
  const gl::Attribute centre{.location = 0,
                             .buffer = &blocks.centres_,
                             .type = gl::AttributeType::Float,
                             .components = 2,
                             .stride = sizeof(Centre)};
  auto points = gl::VertexArray::create(context, std::span(&centre, 1));
  if (!points) return tl::unexpected(points.error());
  blocks.points_ = std::move(*points);
  return blocks;
}

Result<gl::Program> TexelBlocks::program(gl::Context& context, std::span<const gl::ShaderFile> fragment,
                                         std::span<const gl::Define> defines) {
  if (!drawsBlocks(context)) return gl::Program::fullScreen(context, fragment, defines);
  const gl::ShaderFile vertex{"blocks.vert", shaders::sweep::blocks_vert};
  std::vector<gl::Define> all(defines.begin(), defines.end());
  all.push_back({"SIZE", std::to_string(kSize) + ".0"});
  return gl::Program::raster(context, std::span(&vertex, 1), fragment, all);
}

void TexelBlocks::set(std::span<const std::uint8_t> mask) {
  chosen_.clear();
  const auto n = static_cast<std::size_t>(side_);
  // The last block of a row ends with it: a point whose centre lies outside would not be drawn.
  const auto startOf = [this](int block) { return std::min(block, std::max(side_ - kSize, 0)); };
  for (int y = 0; y < side_; y += kSize)
    for (int x = 0; x < side_; x += kSize) {
      const int left = startOf(x), top = startOf(y);
      const int right = std::min(left + kSize, side_), bottom = std::min(top + kSize, side_);
      bool wanted = false;
      for (int row = top; row < bottom && !wanted; ++row) {
        const std::uint8_t* first = &mask[static_cast<std::size_t>(row) * n + static_cast<std::size_t>(left)];
        wanted = std::any_of(first, first + (right - left), [](std::uint8_t m) { return m != 0; });
      }
      if (wanted)
        chosen_.push_back({static_cast<float>(left) + kSize / 2.0f, static_cast<float>(top) + kSize / 2.0f});
    }
  if (!chosen_.empty()) centres_.upload(std::span<const Centre>(chosen_));
}

std::size_t TexelBlocks::texels() const {
  return chosen_.size() * static_cast<std::size_t>(kSize) * static_cast<std::size_t>(kSize);
}

void TexelBlocks::draw(gl::Program& program, gl::Framebuffer& target) const {
  if (whole_) return gl::drawFullScreen(program, target);
  if (chosen_.empty()) return;
  program.set("side", static_cast<float>(side_));
  gl::draw(program, target, points_, static_cast<int>(chosen_.size()), 1, {}, gl::Topology::Points);
}

}  // namespace overfly::tiling::detail
