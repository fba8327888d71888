#include "render/gl/detail/formats.h"

#include <array>

namespace overfly::gl {
namespace detail {
namespace {

constexpr std::array<FormatRow, kFormatCount> kRows{{
    {Format::R8, "r8", GL_R8, GL_RED, GL_UNSIGNED_BYTE, 1, 1, false},
    {Format::RG8, "rg8", GL_RG8, GL_RG, GL_UNSIGNED_BYTE, 2, 2, false},
    {Format::RGB8, "rgb8", GL_RGB8, GL_RGB, GL_UNSIGNED_BYTE, 3, 3, false},
    {Format::RGBA8, "rgba8", GL_RGBA8, GL_RGBA, GL_UNSIGNED_BYTE, 4, 4, true},
    {Format::R16F, "r16f", GL_R16F, GL_RED, GL_HALF_FLOAT, 1, 2, false},
    {Format::RG16F, "rg16f", GL_RG16F, GL_RG, GL_HALF_FLOAT, 2, 4, false},
    {Format::RGBA16F, "rgba16f", GL_RGBA16F, GL_RGBA, GL_HALF_FLOAT, 4, 8, true},
    {Format::R32F, "r32f", GL_R32F, GL_RED, GL_FLOAT, 1, 4, true},
    {Format::RG32F, "rg32f", GL_RG32F, GL_RG, GL_FLOAT, 2, 8, false},
    {Format::RGBA32F, "rgba32f", GL_RGBA32F, GL_RGBA, GL_FLOAT, 4, 16, true},
    {Format::R8UI, "r8ui", GL_R8UI, GL_RED_INTEGER, GL_UNSIGNED_BYTE, 1, 1, false},
    {Format::RGBA8UI, "rgba8ui", GL_RGBA8UI, GL_RGBA_INTEGER, GL_UNSIGNED_BYTE, 4, 4, true},
    {Format::R16UI, "r16ui", GL_R16UI, GL_RED_INTEGER, GL_UNSIGNED_SHORT, 1, 2, false},
    {Format::R32UI, "r32ui", GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT, 1, 4, true},
    {Format::R32I, "r32i", GL_R32I, GL_RED_INTEGER, GL_INT, 1, 4, true},
    {Format::RG32UI, "rg32ui", GL_RG32UI, GL_RG_INTEGER, GL_UNSIGNED_INT, 2, 8, false},
    {Format::RGBA32UI, "rgba32ui", GL_RGBA32UI, GL_RGBA_INTEGER, GL_UNSIGNED_INT, 4, 16, true},
    {Format::Depth24, "depth24", GL_DEPTH_COMPONENT24, GL_DEPTH_COMPONENT, GL_UNSIGNED_INT, 1, 4, false},
    {Format::Depth32F, "depth32f", GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT, GL_FLOAT, 1, 4, false},
}};

constexpr bool rowsStandInOrder() {
  for (int i = 0; i < kFormatCount; ++i) {
    if (static_cast<int>(kRows[static_cast<std::size_t>(i)].format) != i) return false;
  }
  return true;
}
static_assert(rowsStandInOrder());

}  // namespace

const FormatRow& row(Format format) { return kRows[static_cast<std::size_t>(format)]; }

}  // namespace detail

std::string_view formatName(Format format) { return detail::row(format).name; }
int channels(Format format) { return detail::row(format).channels; }
std::size_t bytesPerTexel(Format format) { return static_cast<std::size_t>(detail::row(format).bytes); }
bool isPortableImageFormat(Format format) { return detail::row(format).portable_image; }

}  // namespace overfly::gl
