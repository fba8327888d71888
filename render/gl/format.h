#pragma once
#include <cstddef>
#include <string_view>

namespace overfly::gl {

// Storage of one texel. F: float, UI/I: unpacked integers, plain R8/RG8/RGBA8: normalised to [0, 1].
enum class Format {
  R8,
  RG8,
  RGB8,  // for sampling only: not every device renders into it, and no image can have it
  RGBA8,
  R16F,
  RG16F,
  RGBA16F,
  R32F,
  RG32F,
  RGBA32F,
  R8UI,
  RGBA8UI,
  R16UI,
  R32UI,
  R32I,
  RG32UI,
  RGBA32UI,
  Depth24,
  Depth32F,
};
inline constexpr int kFormatCount = static_cast<int>(Format::Depth32F) + 1;

[[nodiscard]] std::string_view formatName(Format format);
[[nodiscard]] int channels(Format format);
[[nodiscard]] std::size_t bytesPerTexel(Format format);

// Image load/store with this format is promised by OpenGL ES 3.1 itself (table 8.26). Others may work on
// one machine and not on the next: use framebuffers for them.
[[nodiscard]] bool isPortableImageFormat(Format format);

}  // namespace overfly::gl
