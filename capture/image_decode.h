#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "capture/frame.h"
#include "config/error.h"

namespace overfly::capture {

// Larger images are refused, so that a damaged header cannot take all memory: pixels.
inline constexpr std::int64_t kMaxPixels = 200'000'000;

struct ImageSize {
  int width = 0;
  int height = 0;
  friend bool operator==(const ImageSize&, const ImageSize&) = default;
};

// Size from a JPEG's header. BadInput: not a JPEG, or larger than kMaxPixels.
[[nodiscard]] Result<ImageSize> jpegSize(std::span<const std::uint8_t> jpeg);

// nullopt when the sizes, stride and byte count of an image fit together, else one sentence. Jpeg: only that
// there are bytes.
[[nodiscard]] std::optional<std::string> problemOf(const Image& image);

// Pixels of an image as Grey8, Rgb8 or Bgr8, rows without padding. `divide` 1, 2, 4 or 8 gives that fraction
// of the size, rounded up: a JPEG is scaled while it is decoded (as fast as it gets), others by averaging.
// The EXIF orientation is not applied: rows stay as the sensor read them. Nv12 is taken as full-range BT.601,
// which is also JPEG's. BadInput: damaged or cut data, sizes that do not fit. Reentrant.
[[nodiscard]] Result<Image> decodeImage(const Image& image, PixelFormat format, int divide = 1);

// Pixels of four bytes (R, G, B, unused), rows without gaps.
struct WordImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgbx;
};
// The same as decodeImage() to Rgb8, in words: what the CPU samples fastest, in one pass from a JPEG, Rgb8 or
// Bgr8. `reuse`: memory for rgbx, of an image that is no longer needed; it saves the kernel's clearing of new
// pages, which costs as much as the decoding. Reentrant.
[[nodiscard]] Result<WordImage> decodeImageWords(const Image& image, int divide = 1,
                                                 std::vector<std::uint8_t>&& reuse = {});

// A JPEG of a plain image (Grey8, Nv12, Rgb8, Bgr8), quality 1..100. BadInput as above.
[[nodiscard]] Result<Image> encodeJpeg(const Image& image, int quality);

}  // namespace overfly::capture
