#include "capture/pixel_layout.h"

#include <fmt/format.h>
#include <linux/videodev2.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "capture/image_decode.h"

namespace overfly::capture {
namespace {

using Format = LiveCameraOptions::Format;

constexpr std::array kLayouts{
    PixelLayout{V4L2_PIX_FMT_MJPEG, Format::Mjpeg, PixelFormat::Jpeg},
    PixelLayout{V4L2_PIX_FMT_JPEG, Format::Mjpeg, PixelFormat::Jpeg},
    PixelLayout{V4L2_PIX_FMT_NV12, Format::Nv12, PixelFormat::Nv12},
    PixelLayout{V4L2_PIX_FMT_YUYV, Format::Yuyv, PixelFormat::Nv12},
    PixelLayout{V4L2_PIX_FMT_RGB24, Format::Rgb, PixelFormat::Rgb8},
    PixelLayout{V4L2_PIX_FMT_BGR24, Format::Rgb, PixelFormat::Bgr8},
    PixelLayout{V4L2_PIX_FMT_SRGGB8, Format::Bayer8, PixelFormat::Rgb8, 8, 0, 0},
    PixelLayout{V4L2_PIX_FMT_SGRBG8, Format::Bayer8, PixelFormat::Rgb8, 8, 1, 0},
    PixelLayout{V4L2_PIX_FMT_SGBRG8, Format::Bayer8, PixelFormat::Rgb8, 8, 0, 1},
    PixelLayout{V4L2_PIX_FMT_SBGGR8, Format::Bayer8, PixelFormat::Rgb8, 8, 1, 1},
    PixelLayout{V4L2_PIX_FMT_SRGGB10, Format::Bayer10, PixelFormat::Rgb8, 10, 0, 0},
    PixelLayout{V4L2_PIX_FMT_SGRBG10, Format::Bayer10, PixelFormat::Rgb8, 10, 1, 0},
    PixelLayout{V4L2_PIX_FMT_SGBRG10, Format::Bayer10, PixelFormat::Rgb8, 10, 0, 1},
    PixelLayout{V4L2_PIX_FMT_SBGGR10, Format::Bayer10, PixelFormat::Rgb8, 10, 1, 1},
    PixelLayout{V4L2_PIX_FMT_GREY, Format::Grey, PixelFormat::Grey8},
};

// Limited range to full, ITU-R BT.601: luma 16..235, chroma 16..240 about 128. 16 fractional bits.
using Stretch = std::array<std::uint8_t, 256>;
constexpr Stretch stretched(int from, int to, int factor) {
  Stretch table{};
  for (int value = 0; value < 256; ++value)
    table[static_cast<std::size_t>(value)] =
        static_cast<std::uint8_t>(std::clamp((((value - from) * factor + 32768) >> 16) + to, 0, 255));
  return table;
}
constexpr Stretch kLuma = stretched(16, 0, 76309), kChroma = stretched(128, 128, 74606);
constexpr Stretch kAsIs = stretched(0, 0, 65536);

struct Source {
  const std::uint8_t* bytes;
  std::size_t stride;
  int width, height;

  [[nodiscard]] const std::uint8_t* row(int y) const { return bytes + static_cast<std::size_t>(y) * stride; }
};

Image blank(PixelFormat format, int width, int height, int stride, int rows) {
  Image image;
  image.format = format;
  image.width = width;
  image.height = height;
  image.stride = stride;
  image.bytes.resize(static_cast<std::size_t>(stride) * static_cast<std::size_t>(rows));
  return image;
}

std::uint8_t* rowOf(Image& image, int y) {
  return image.bytes.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(image.stride);
}

// Rows without padding.
Image copyRows(const Source& in, PixelFormat format, int row_bytes, int rows) {
  Image out = blank(format, in.width, in.height, row_bytes, rows);
  for (int y = 0; y < rows; ++y) std::memcpy(rowOf(out, y), in.row(y), static_cast<std::size_t>(row_bytes));
  return out;
}

int evenWidth(int width) { return width + width % 2; }
int chromaRows(int height) { return (height + 1) / 2; }

Image fromNv12(const Source& in, bool limited_range) {
  Image out = copyRows(in, PixelFormat::Nv12, evenWidth(in.width), in.height + chromaRows(in.height));
  if (limited_range) {
    const auto luma = out.bytes.begin() + static_cast<std::ptrdiff_t>(out.stride) * in.height;
    const auto stretch = [](const Stretch& table) {
      return [&table](std::uint8_t value) { return table[value]; };
    };
    std::transform(out.bytes.begin(), luma, out.bytes.begin(), stretch(kLuma));
    std::transform(luma, out.bytes.end(), luma, stretch(kChroma));
  }
  return out;
}

Image fromYuyv(const Source& in, bool limited_range) {
  const int stride = evenWidth(in.width);
  const Stretch &of_luma = limited_range ? kLuma : kAsIs, &of_chroma = limited_range ? kChroma : kAsIs;
  Image out = blank(PixelFormat::Nv12, in.width, in.height, stride, in.height + chromaRows(in.height));
  for (int y = 0; y < in.height; ++y) {
    const std::uint8_t* row = in.row(y);
    std::uint8_t* luma = rowOf(out, y);
    for (int x = 0; x < stride; ++x) luma[x] = of_luma[row[2 * x]];
    if (y % 2 == 1) continue;
    const std::uint8_t* below = y + 1 < in.height ? in.row(y + 1) : row;
    std::uint8_t* chroma = rowOf(out, in.height + y / 2);
    for (int x = 0; x < stride; ++x)
      chroma[x] = of_chroma[static_cast<std::size_t>(row[2 * x + 1] + below[2 * x + 1] + 1) / 2];
  }
  return out;
}

template <int Bits>
int sampleOf(const std::uint8_t* row, int x) {
  if constexpr (Bits == 8) {
    return row[x];
  } else {
    return (row[2 * x] | row[2 * x + 1] << 8) >> 2;
  }
}

// One row of the mosaic; rows above and below are mirrored at the border, which keeps their colours.
template <int Bits>
void demosaicRow(const Source& in, const PixelLayout& layout, int y, std::uint8_t* out) {
  const std::uint8_t* row = in.row(y);
  const std::uint8_t* above = in.row(y > 0 ? y - 1 : y + 1);
  const std::uint8_t* below = in.row(y + 1 < in.height ? y + 1 : y - 1);
  const bool red_row = y % 2 == layout.red_y;
  for (int x = 0; x < in.width; ++x) {
    const int left = x > 0 ? x - 1 : x + 1, right = x + 1 < in.width ? x + 1 : x - 1;
    const int here = sampleOf<Bits>(row, x);
    const int beside = (sampleOf<Bits>(row, left) + sampleOf<Bits>(row, right) + 1) / 2;
    const int over = (sampleOf<Bits>(above, x) + sampleOf<Bits>(below, x) + 1) / 2;
    const bool red_column = x % 2 == layout.red_x;
    int red = beside, green = here, blue = over;  // green between two reds
    if (red_row == red_column) {
      green = (beside + over + 1) / 2;
      const int across = (sampleOf<Bits>(above, left) + sampleOf<Bits>(above, right) +
                          sampleOf<Bits>(below, left) + sampleOf<Bits>(below, right) + 2) /
                         4;
      red = red_row ? here : across;
      blue = red_row ? across : here;
    } else if (!red_row) {  // green between two blues
      red = over;
      blue = beside;
    }
    out[3 * x] = static_cast<std::uint8_t>(red);
    out[3 * x + 1] = static_cast<std::uint8_t>(green);
    out[3 * x + 2] = static_cast<std::uint8_t>(blue);
  }
}

Image fromMosaic(const Source& in, const PixelLayout& layout) {
  Image out = blank(PixelFormat::Rgb8, in.width, in.height, 3 * in.width, in.height);
  for (int y = 0; y < in.height; ++y) {
    if (layout.bayer_bits == 8) {
      demosaicRow<8>(in, layout, y, rowOf(out, y));
    } else {
      demosaicRow<10>(in, layout, y, rowOf(out, y));
    }
  }
  return out;
}

Result<Image> takeJpeg(std::span<const std::uint8_t> buffer) {
  const auto size = jpegSize(buffer);
  if (!size) return tl::unexpected(size.error());
  Image image;
  image.format = PixelFormat::Jpeg;
  image.width = size->width;
  image.height = size->height;
  image.bytes.assign(buffer.begin(), buffer.end());
  return image;
}

}  // namespace

std::span<const PixelLayout> knownLayouts() { return kLayouts; }

std::optional<PixelLayout> layoutOf(std::uint32_t fourcc) {
  const auto found = std::find_if(kLayouts.begin(), kLayouts.end(),
                                  [&](const PixelLayout& layout) { return layout.fourcc == fourcc; });
  if (found == kLayouts.end()) return std::nullopt;
  return *found;
}

Result<Image> takeImage(std::span<const std::uint8_t> buffer, const PixelLayout& layout, int width,
                        int height, int stride, bool limited_range) {
  if (layout.becomes == PixelFormat::Jpeg) return takeJpeg(buffer);
  int row_bytes = width, rows = height;
  switch (layout.format) {
    case Format::Nv12:
      row_bytes = evenWidth(width);
      rows = height + chromaRows(height);
      break;
    case Format::Yuyv:
      row_bytes = 2 * evenWidth(width);
      break;
    case Format::Rgb:
      row_bytes = 3 * width;
      break;
    case Format::Bayer10:
      row_bytes = 2 * width;
      break;
    default:
      break;
  }
  const int least = layout.bayer_bits > 0 ? 2 : 1;
  const std::size_t needed =
      static_cast<std::size_t>(std::max(stride, 0)) * static_cast<std::size_t>(std::max(rows - 1, 0)) +
      static_cast<std::size_t>(row_bytes);
  if (width < least || height < least || stride < row_bytes || buffer.size() < needed) {
    return fail(ErrorCode::BadInput, fmt::format("the buffer has {} bytes, {}x{} in rows of {} takes {}",
                                                 buffer.size(), width, height, stride, needed));
  }
  const Source source{buffer.data(), static_cast<std::size_t>(stride), width, height};
  switch (layout.format) {
    case Format::Nv12:
      return fromNv12(source, limited_range);
    case Format::Yuyv:
      return fromYuyv(source, limited_range);
    case Format::Bayer8:
    case Format::Bayer10:
      return fromMosaic(source, layout);
    default:
      return copyRows(source, layout.becomes, row_bytes, rows);
  }
}

}  // namespace overfly::capture
