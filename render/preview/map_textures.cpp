#include "render/preview/map_textures.h"

#include <algorithm>
#include <bit>
#include <string>

namespace overfly::preview {
namespace {
constexpr int kMaxLevels = 30;      // domain.h allows no more
constexpr int kTextureSize = 2048;  // what OpenGL ES 3.1 promises
constexpr gl::Sampling kNearest{gl::Filter::Nearest, gl::Filter::Nearest, false, gl::Wrap::Clamp};
constexpr gl::Sampling kLinear{gl::Filter::Linear, gl::Filter::Linear, false, gl::Wrap::Clamp};
}  // namespace

std::size_t MapTextures::bytesPerTile(int tile_size) {
  const auto n = static_cast<std::size_t>(tile_size), r = n + 2;
  return r * r * (4 + 4) + n * n * (4 + 2);
}

Result<std::unique_ptr<MapTextures>> MapTextures::create(gl::Context& context, int tile_size, int slots) {
  const int atlas = std::clamp(kTextureSize / (tile_size + 2), 1, 4);
  std::unique_ptr<MapTextures> out(new MapTextures(tile_size, atlas, slots));
  const int layers = (slots + 2 + atlas * atlas - 1) / (atlas * atlas);
  if (layers > context.info().limits.texture_layers)
    return fail(ErrorCode::Unsupported, "this GPU has too few texture layers for the preview's tiles");
  const auto make = [&](gl::Texture& texture, gl::Format format, int size,
                        const gl::Sampling& sampling) -> Result<void> {
    gl::TextureSpec spec;
    spec.format = format;
    spec.width = spec.height = size;
    spec.layers = layers;
    spec.sampling = sampling;
    auto made = gl::Texture::create(context, spec);
    if (!made) return tl::unexpected(made.error());
    texture = std::move(*made);
    return {};
  };
  const int rimmed = atlas * (tile_size + 2), plain = atlas * tile_size;
  for (const Result<void>& made : {make(out->heights_, gl::Format::R32F, rimmed, kNearest),
                                   make(out->bounds_, gl::Format::R32F, plain, kNearest),
                                   make(out->color_, gl::Format::RGBA8, rimmed, kLinear),
                                   make(out->quality_, gl::Format::RG8, plain, kNearest)})
    if (!made) return tl::unexpected(made.error());
  return out;
}

gl::Rect MapTextures::place(int slot, int rim) const {
  const int in_layer = slot % (atlas_ * atlas_), stride = tile_size_ + 2 * rim;
  return {in_layer % atlas_ * stride, in_layer / atlas_ * stride, stride, stride};
}

// As levelPlace() of shaders/map.glsl has it.
gl::Rect MapTextures::topPlace(int mip, int rim) const {
  gl::Rect rect = place(topSlot(mip), rim);
  rect.width = rect.height = (tile_size_ >> mip) + 2 * rim;
  if (mip < 2) return rect;
  rect.x += tile_size_ / 2 + 2 * rim;
  rect.y += tile_size_ / 2 - (tile_size_ >> (mip - 1)) + 2 * rim * (mip - 2);
  return rect;
}

void MapTextures::uploadTile(int slot, const TileImage& image) {
  const int layer = slot / (atlas_ * atlas_);
  const gl::Rect rimmed = place(slot, 1), plain = place(slot, 0);
  heights_.upload(std::span<const float>(image.heights), rimmed, 0, layer);
  bounds_.upload(std::span<const float>(image.bounds), plain, 0, layer);
  color_.upload(std::span<const std::uint8_t>(image.color), rimmed, 0, layer);
  quality_.upload(std::span<const std::uint8_t>(image.quality), plain, 0, layer);
}

void MapTextures::uploadBounds(int slot, const BoundsPatch& patch) {
  const gl::Rect tile = place(slot, 0);
  bounds_.upload(std::span<const float>(patch.values),
                 gl::Rect{tile.x + patch.x, tile.y + patch.y, patch.size, patch.size}, 0,
                 slot / (atlas_ * atlas_));
}

void MapTextures::uploadTop(const TopImage& top) {
  for (std::size_t i = 0; i < top.levels.size(); ++i) {
    const TileImage& image = top.levels[i];
    const int mip = static_cast<int>(i), layer = topSlot(mip) / (atlas_ * atlas_);
    const gl::Rect rimmed = topPlace(mip, 1), plain = topPlace(mip, 0);
    heights_.upload(std::span<const float>(image.heights), rimmed, 0, layer);
    bounds_.upload(std::span<const float>(image.bounds), plain, 0, layer);
    color_.upload(std::span<const std::uint8_t>(image.color), rimmed, 0, layer);
    quality_.upload(std::span<const std::uint8_t>(image.quality), plain, 0, layer);
  }
}

void MapTextures::uploadTopBounds(int mip, const BoundsPatch& patch) {
  const gl::Rect level = topPlace(mip, 0);
  bounds_.upload(std::span<const float>(patch.values),
                 gl::Rect{level.x + patch.x, level.y + patch.y, patch.size, patch.size}, 0,
                 topSlot(mip) / (atlas_ * atlas_));
}

Result<void> MapTextures::uploadTable(gl::Context& context, const ClipCache& cache) {
  const Domain& domain = cache.domain();
  top_level_ = domain.levels() - 1;
  last_level_ = domain.lastLevel();
  int stride = 2;
  for (int l = 0; l < top_level_; ++l) stride = std::max(stride, cache.layout().active(l).width);
  if (table_.empty() || table_.width() < stride || table_.height() < stride * (last_level_ + 1)) {
    table_stride_ = std::max(stride, table_.empty() ? 0 : table_.width());
    gl::TextureSpec spec;
    spec.format = gl::Format::RG32UI;
    spec.width = table_stride_;
    spec.height = table_stride_ * (last_level_ + 1);
    spec.sampling = kNearest;
    auto made = gl::Texture::create(context, spec);
    if (!made) return tl::unexpected(made.error());
    table_ = std::move(*made);
  }
  std::vector<std::uint32_t> texels(2 * static_cast<std::size_t>(table_.width()) *
                                    static_cast<std::size_t>(table_.height()));
  windows_.assign(kMaxLevels, Eigen::Vector4f::Zero());
  for (int l = 0; l < top_level_; ++l) {
    const TileWindow& window = cache.layout().active(l);
    windows_[static_cast<std::size_t>(l)] =
        Eigen::Vector4i(window.x, window.y, window.width, window.height).cast<float>();
    const auto entries = cache.table(l);
    for (int y = 0; y < window.height; ++y) {
      for (int x = 0; x < window.width; ++x) {
        const ClipCache::TableEntry& entry = entries[static_cast<std::size_t>(y * window.width + x)];
        const auto to = 2 * static_cast<std::size_t>((l * table_stride_ + y) * table_.width() + x);
        texels[to] = entry.slot;
        texels[to + 1] = entry.age;
      }
    }
  }
  for (int l = top_level_; l <= last_level_; ++l) {
    windows_[static_cast<std::size_t>(l)] = Eigen::Vector4f(0, 0, 1, 1);
    texels[2 * static_cast<std::size_t>(l * table_stride_ * table_.width())] =
        static_cast<std::uint32_t>(topSlot(l - top_level_) + 1);
  }
  table_.upload(std::span<const std::uint32_t>(texels));
  return {};
}

void MapTextures::bind(gl::Program& program) const {
  program.setTexture("height_tiles", 0, heights_);
  program.setTexture("bound_tiles", 1, bounds_);
  program.setTexture("color_tiles", 2, color_);
  program.setTexture("quality_tiles", 3, quality_);
  program.setTexture("slots", 4, table_);
  program.set("top_level", top_level_);
  program.set("last_level", last_level_);
  program.set("table_stride", table_stride_);
  program.set("window", std::span<const Eigen::Vector4f>(windows_));
}

std::vector<gl::Define> MapTextures::defines() const {
  return {{"MAX_LEVELS", std::to_string(kMaxLevels)},
          {"TILE_LOG2", std::to_string(std::countr_zero(static_cast<unsigned>(tile_size_)))},
          {"ATLAS", std::to_string(atlas_)}};
}

std::size_t MapTextures::bytes() const {
  return heights_.bytes() + bounds_.bytes() + color_.bytes() + quality_.bytes() + table_.bytes();
}

}  // namespace overfly::preview
