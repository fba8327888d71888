#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "capture/frame.h"
#include "capture/live_camera_options.h"
#include "config/error.h"

namespace overfly::capture {

// How a camera lays out the pixels that overfly can take, and what they become. Value type.
struct PixelLayout {
  std::uint32_t fourcc = 0;  // V4L2_PIX_FMT_*
  LiveCameraOptions::Format format = LiveCameraOptions::Format::Auto;
  PixelFormat becomes = PixelFormat::Jpeg;
  int bayer_bits = 0;  // 8 or 10 (in 16, little endian); 0: no Bayer mosaic
  int red_x = 0;       // place of red in the 2x2 mosaic
  int red_y = 0;
};

// All of them, best first (LiveCameraOptions::Format::Auto).
[[nodiscard]] std::span<const PixelLayout> knownLayouts();
[[nodiscard]] std::optional<PixelLayout> layoutOf(std::uint32_t fourcc);

// A driver's buffer as overfly's image, copied once. YUYV becomes Nv12 (chroma of two rows averaged), a
// mosaic becomes Rgb8 (bilinear: each missing colour is the mean of its nearest neighbours), 10 bits become
// the upper 8; Nv12 and YUYV of limited range (16..235) are stretched to the full one. `stride`: bytes per
// row of the first plane. BadInput: too few bytes for the size, or a JPEG whose header does not read.
// Reentrant.
[[nodiscard]] Result<Image> takeImage(std::span<const std::uint8_t> buffer, const PixelLayout& layout,
                                      int width, int height, int stride, bool limited_range);

}  // namespace overfly::capture
