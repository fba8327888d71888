#include "tests/bench/preview/mesh_peer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "preview_shaders.h"
#include "render/gl/commands.h"
#include "render/preview/focus.h"

namespace overfly::bench {
namespace {

namespace text = overfly::shaders::preview;
constexpr int kChunk = 32;  // texels on each side of what is drawn at one level

constexpr std::string_view kVertex = R"(
layout(location = 0) in vec2 corner;  // texels from the chunk's first
uniform int tile_level;
uniform ivec2 chunk_first;            // cell
uniform int tile_slot;
uniform mat3 metres;                  // East-North-Up from map coordinates
uniform mat3 bend_x, bend_y, bend_z;
uniform mat3 camera_from_enu;
uniform vec3 start;
uniform vec4 lens;                    // focal lengths over half the picture, near, far
out vec3 position;
void main() {
  // Vertices lie at the texels' centres, where the heights are.
  vec2 local = vec2(chunk_first - originAt(tile_level)) + corner + 0.5 - originFraction(tile_level);
  float h = texelFetch(height_tiles, inAtlas(tile_level, chunk_first, tile_slot, 1) + ivec3(ivec2(corner), 0), 0).r;
  position = vec3(local * power2(tile_level), h);
  vec3 e = metres * (position - start);
  e -= metres * vec3(dot(e, bend_x * e), dot(e, bend_y * e), dot(e, bend_z * e));
  vec3 c = camera_from_enu * e;
  gl_Position = vec4(c.x * lens.x, c.y * lens.y, (c.z * (lens.w + lens.z) - 2.0 * lens.w * lens.z) / (lens.w - lens.z), c.z);
}
)";
constexpr std::string_view kFragment = R"(
in vec3 position;
layout(location = 0) out vec4 color;
void main() {
  vec2 dx = dFdx(position.xy), dy = dFdy(position.xy);
  vec4 sampled = filteredColor(position.xy, dx, dy, 0.0);
  color = vec4(sampled.rgb / max(sampled.a, 0.01), 1.0);
}
)";

}  // namespace

Result<MeshPeer> MeshPeer::create(gl::Context& context, const preview::MapTextures& textures, int tile_size) {
  MeshPeer peer;
  peer.tile_size_ = tile_size;
  const gl::ShaderFile vertex[] = {{"map.glsl", text::map_glsl}, {"mesh.vert", kVertex}};
  const gl::ShaderFile fragment[] = {
      {"map.glsl", text::map_glsl}, {"color.glsl", text::color_glsl}, {"mesh.frag", kFragment}};
  std::vector<gl::Define> defines = textures.defines();
  defines.push_back({"FILTER", "2"});
  auto program = gl::Program::raster(context, vertex, fragment, defines);
  if (!program) return tl::unexpected(program.error());
  peer.program_ = std::move(*program);
  std::vector<float> corners;
  for (int y = 0; y <= kChunk; ++y)
    for (int x = 0; x <= kChunk; ++x)
      corners.insert(corners.end(), {static_cast<float>(x), static_cast<float>(y)});
  std::vector<std::uint32_t> indices;
  for (int y = 0; y < kChunk; ++y) {
    for (int x = 0; x < kChunk; ++x) {
      const auto a = static_cast<std::uint32_t>(y * (kChunk + 1) + x), b = a + kChunk + 1;
      indices.insert(indices.end(), {a, a + 1, b, b, a + 1, b + 1});
    }
  }
  peer.index_count_ = indices.size();
  auto corner_buffer = gl::Buffer::from(context, std::span<const float>(corners));
  if (!corner_buffer) return tl::unexpected(corner_buffer.error());
  auto index_buffer = gl::Buffer::from(context, std::span<const std::uint32_t>(indices));
  if (!index_buffer) return tl::unexpected(index_buffer.error());
  peer.corners_ = std::move(*corner_buffer);
  peer.indices_ = std::move(*index_buffer);
  const gl::Attribute attribute{0, &peer.corners_, gl::AttributeType::Float, 2, 2 * sizeof(float), 0};
  auto grid = gl::VertexArray::create(context, {&attribute, 1}, &peer.indices_);
  if (!grid) return tl::unexpected(grid.error());
  peer.grid_ = std::move(*grid);
  return peer;
}

Result<std::size_t> MeshPeer::draw(gl::Context& context, const preview::View& view,
                                   const preview::RayFrame& frame, const preview::ClipCache& cache,
                                   const preview::MapTextures& textures, double texel_pixels) {
  if (color_.empty() || color_.width() != view.width || color_.height() != view.height) {
    gl::TextureSpec spec;
    spec.width = view.width;
    spec.height = view.height;
    auto color = gl::Texture::create(context, spec);
    spec.format = gl::Format::Depth32F;
    spec.sampling = {gl::Filter::Nearest, gl::Filter::Nearest, false, gl::Wrap::Clamp};
    auto depth = gl::Texture::create(context, spec);
    if (!color || !depth) return tl::unexpected(color ? depth.error() : color.error());
    color_ = std::move(*color);
    depth_ = std::move(*depth);
    const gl::Attachment attachment{&color_, 0, 0};
    auto target = gl::Framebuffer::create(context, {&attachment, 1}, {&depth_, 0, 0});
    if (!target) return tl::unexpected(target.error());
    target_ = std::move(*target);
  }
  target_.clearColor(0, 0.8F, 0.87F, 0.93F, 1);
  target_.clearDepth(1);
  const Eigen::Matrix3d metres = frame.per_metre.inverse();
  const Eigen::Matrix3d camera_from_enu = view.enuFromCamera().transpose();
  const double f = view.focal(), near_m = 2, far_m = 60000;
  textures.bind(program_);
  program_.set("origin_cell", frame.cell);
  program_.set("metres", Eigen::Matrix3f(metres.cast<float>()));
  program_.set("bend_x", Eigen::Matrix3f(frame.bend[0].cast<float>()));
  program_.set("bend_y", Eigen::Matrix3f(frame.bend[1].cast<float>()));
  program_.set("bend_z", Eigen::Matrix3f(frame.bend[2].cast<float>()));
  program_.set("camera_from_enu", Eigen::Matrix3f(camera_from_enu.cast<float>()));
  program_.set("start", Eigen::Vector3f(frame.start.cast<float>()));
  program_.set(
      "lens", Eigen::Vector4f(static_cast<float>(2 * f / view.width), static_cast<float>(2 * f / view.height),
                              static_cast<float>(near_m), static_cast<float>(far_m)));
  const preview::Domain& domain = cache.domain();
  const double per_metre = preview::levelsPerMetre(view, domain);
  std::size_t triangles = 0;
  std::vector<std::vector<preview::ClipCache::TableEntry>> tables;
  for (int l = 0; l <= domain.levels() - 2; ++l) tables.push_back(cache.table(l));
  // Of the tile that chunk (x, y) lies in; negative: not in GPU memory.
  const int chunks = tile_size_ / kChunk;
  const auto slotOf = [&](int level, int x, int y) {
    x /= chunks;
    y /= chunks;
    const preview::TileWindow& window = cache.layout().active(level);
    if (!window.contains(x, y)) return -1;
    return static_cast<int>(tables[static_cast<std::size_t>(level)]
                                  [static_cast<std::size_t>((y - window.y) * window.width + x - window.x)]
                                      .slot) -
           1;
  };
  const std::function<void(int, int, int)> visit = [&](int level, int x, int y) {
    // In front of the camera and within its side planes: by the chunk's bounding sphere.
    const double side = std::ldexp(kChunk, level);
    const Eigen::Vector3d middle((x + 0.5) * side - frame.cell.x(), (y + 0.5) * side - frame.cell.y(),
                                 (cache.lowest() + cache.highest()) / 2 - frame.base_height_m);
    const Eigen::Vector3d c = camera_from_enu * (metres * (middle - frame.start));
    const double radius =
        std::hypot(0.71 * side * domain.texelSize(), (cache.highest() - cache.lowest()) / 2);
    const double tx = 0.5 * view.width / f, ty = 0.5 * view.height / f;
    if (c.z() < -radius || std::abs(c.x()) > c.z() * tx + radius * std::hypot(1, tx) ||
        std::abs(c.y()) > c.z() * ty + radius * std::hypot(1, ty))
      return;
    // The next finer level's texels would still cover so many pixels.
    const double pixel = std::max(c.norm(), 1.0) * per_metre;
    bool finer = level > 0 && std::ldexp(1.0, level - 1) >= pixel * texel_pixels;
    for (int i = 0; i < 4 && finer; ++i) finer = slotOf(level - 1, 2 * x + (i & 1), 2 * y + (i >> 1)) >= 0;
    if (finer) {
      for (int i = 0; i < 4; ++i) visit(level - 1, 2 * x + (i & 1), 2 * y + (i >> 1));
      return;
    }
    const int slot = slotOf(level, x, y);
    if (slot < 0) return;
    program_.set("tile_slot", slot);
    program_.set("tile_level", level);
    program_.set("chunk_first", Eigen::Vector2i(x * kChunk, y * kChunk));
    gl::DrawState state;
    state.depth_test = state.depth_write = true;
    gl::draw(program_, target_, grid_, static_cast<int>(index_count_), 1, state);
    triangles += index_count_ / 3;
  };
  for (int y = 0; y < 2 * chunks; ++y)
    for (int x = 0; x < 2 * chunks; ++x) visit(domain.levels() - 2, x, y);
  context.finish();
  if (auto fine = context.check(); !fine) return tl::unexpected(fine.error());
  return triangles;
}

Result<std::vector<std::uint8_t>> MeshPeer::read() const {
  std::vector<std::uint8_t> out(static_cast<std::size_t>(color_.width()) *
                                static_cast<std::size_t>(color_.height()) * 4);
  if (auto done = color_.download(std::span<std::uint8_t>(out)); !done) return tl::unexpected(done.error());
  return out;
}

}  // namespace overfly::bench
