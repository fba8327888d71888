#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "config/error.h"
#include "render/gl/context.h"
#include "render/gl/format.h"

namespace overfly::gl {

enum class Filter { Nearest, Linear };
enum class Wrap { Clamp, Repeat, MirroredRepeat };
enum class ImageAccess { Read, Write, ReadWrite };

// How a texture is read. Lives in the texture, not in a sampler object.
struct Sampling {
  Filter magnify = Filter::Linear;
  Filter minify = Filter::Linear;
  bool between_levels = false;  // linear between two mip levels; only used when there are levels
  Wrap wrap = Wrap::Clamp;
};

struct TextureSpec {
  Format format = Format::RGBA8;
  int width = 0;
  int height = 0;
  int layers = 0;  // 0: a plain 2D texture, else an array
  int levels = 1;  // mip levels; kFullChain for all down to 1x1
  int samples =
      0;  // 0: plain; else multi-sampled: rendered into, resolved (commands.h) or read as sampler2DMS
  Sampling sampling{};
};
inline constexpr int kFullChain = 0;
[[nodiscard]] int fullChainLevels(int width, int height);

// Part of one mip level: pixels, row 0 first in memory.
struct Rect {
  int x = 0, y = 0, width = 0, height = 0;
};

// Client-side component types that uploads and downloads know: uint8, uint16, uint32, int32, float. Float is
// taken for the 16F formats too (the driver converts); uint16 means raw halves there.
enum class Component { U8, U16, U32, I32, F32 };
template <typename T>
constexpr Component componentOf() {
  using V = std::remove_const_t<T>;
  if constexpr (std::is_same_v<V, std::uint8_t>)
    return Component::U8;
  else if constexpr (std::is_same_v<V, std::uint16_t>)
    return Component::U16;
  else if constexpr (std::is_same_v<V, std::uint32_t>)
    return Component::U32;
  else if constexpr (std::is_same_v<V, std::int32_t>)
    return Component::I32;
  else {
    static_assert(std::is_same_v<V, float>, "no such texture component");
    return Component::F32;
  }
}

// A 2D texture or an array of equal ones, immutable in size and format. Thread-bound to its context.
class Texture {
 public:
  Texture() = default;
  // Contents are undefined until written. Unavailable: out of memory or lost; Unsupported: larger than the
  // device's limits.
  [[nodiscard]] static Result<Texture> create(Context& context, const TextureSpec& spec);

  [[nodiscard]] const TextureSpec& spec() const { return spec_; }  // levels resolved
  [[nodiscard]] int width(int level = 0) const;
  [[nodiscard]] int height(int level = 0) const;
  [[nodiscard]] std::size_t bytes() const;  // of GPU memory, all levels and layers
  [[nodiscard]] bool empty() const { return object_.empty(); }

  // Whole level (of one layer). `row_stride` in texels, 0: tight. The span must cover the rectangle (a
  // programming error otherwise).
  template <typename T>
  void upload(std::span<const T> texels, int level = 0, int layer = 0, int row_stride = 0) {
    upload(texels, Rect{0, 0, width(level), height(level)}, level, layer, row_stride);
  }
  template <typename T>
  void upload(std::span<const T> texels, const Rect& rect, int level = 0, int layer = 0, int row_stride = 0) {
    uploadBytes(std::as_bytes(texels), componentOf<T>(), rect, level, layer, row_stride);
  }

  // Reads back through a framebuffer: Unsupported where the format is not renderable. Channels of the
  // format, tight rows. 16F formats come as float.
  template <typename T>
  [[nodiscard]] Result<void> download(std::span<T> texels, int level = 0, int layer = 0) const {
    return download(texels, Rect{0, 0, width(level), height(level)}, level, layer);
  }
  template <typename T>
  [[nodiscard]] Result<void> download(std::span<T> texels, const Rect& rect, int level = 0,
                                      int layer = 0) const {
    return downloadBytes(std::as_writable_bytes(texels), componentOf<T>(), rect, level, layer);
  }

  void generateMips();  // the driver's box filter from level 0
  void setSampling(const Sampling& sampling);
  // Restricts sampling to levels first..last.
  void setLevelRange(int first, int last);

  void bind(int unit) const;
  // For imageLoad/imageStore; `layer` -1 binds all layers of an array.
  void bindImage(int unit, ImageAccess access, int level = 0, int layer = -1) const;

  [[nodiscard]] const detail::Object& object() const { return object_; }

 private:
  void uploadBytes(std::span<const std::byte> texels, Component component, const Rect& rect, int level,
                   int layer, int row_stride);
  [[nodiscard]] Result<void> downloadBytes(std::span<std::byte> texels, Component component, const Rect& rect,
                                           int level, int layer) const;
  detail::Object object_;
  TextureSpec spec_;
};

}  // namespace overfly::gl
