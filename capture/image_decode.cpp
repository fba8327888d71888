#include "capture/image_decode.h"

#include <fmt/format.h>
#include <turbojpeg.h>

#include <algorithm>
#include <cstring>
#include <memory>

namespace overfly::capture {
namespace {

struct Destroy {
  void operator()(void* handle) const { tjDestroy(handle); }
};
using Handle = std::unique_ptr<void, Destroy>;

int channelsOf(PixelFormat format) { return format == PixelFormat::Grey8 ? 1 : 3; }

Result<ImageSize> readHeader(void* decoder, std::span<const std::uint8_t> jpeg) {
  int width = 0, height = 0, subsampling = 0, colours = 0;
  if (tjDecompressHeader3(decoder, jpeg.data(), jpeg.size(), &width, &height, &subsampling, &colours) != 0) {
    return fail(ErrorCode::BadInput, fmt::format("not a readable JPEG: {}", tjGetErrorStr2(decoder)));
  }
  if (std::int64_t{width} * height > kMaxPixels) {
    return fail(ErrorCode::BadInput,
                fmt::format("the JPEG's header says {}x{}, beyond the {} megapixels allowed", width, height,
                            kMaxPixels / 1'000'000));
  }
  return ImageSize{width, height};
}

Image blank(PixelFormat format, int width, int height) {
  Image image;
  image.format = format;
  image.width = width;
  image.height = height;
  image.stride = width * channelsOf(format);
  image.bytes.resize(static_cast<std::size_t>(image.stride) * static_cast<std::size_t>(height));
  return image;
}

// `out(size)` gives the memory for a picture of that size.
template <typename Out>
Result<void> decodeJpegInto(const Image& jpeg, int layout, int divide, const Out& out) {
  const Handle decoder(tjInitDecompress());
  if (!decoder) return fail(ErrorCode::Internal, "libjpeg-turbo does not start");
  const auto full = readHeader(decoder.get(), jpeg.bytes);
  if (!full) return tl::unexpected(full.error());
  const ImageSize size{(full->width + divide - 1) / divide, (full->height + divide - 1) / divide};
  if (tjDecompress2(decoder.get(), jpeg.bytes.data(), jpeg.bytes.size(), out(size), size.width,
                    size.width * tjPixelSize[layout], size.height, layout, TJFLAG_ACCURATEDCT) != 0) {
    // Some cameras leave padding between markers: the one warning that says nothing about the pixels.
    const char* reason = tjGetErrorStr2(decoder.get());
    if (tjGetErrorCode(decoder.get()) != TJERR_WARNING || !std::strstr(reason, "extraneous bytes")) {
      return fail(ErrorCode::BadInput, fmt::format("the JPEG is damaged: {}", reason));
    }
  }
  return {};
}

Result<Image> decodeJpeg(const Image& jpeg, PixelFormat format, int divide) {
  Image image;
  const int layout = format == PixelFormat::Grey8  ? TJPF_GRAY
                     : format == PixelFormat::Rgb8 ? TJPF_RGB
                                                   : TJPF_BGR;
  const auto done = decodeJpegInto(jpeg, layout, divide, [&](const ImageSize& size) {
    image = blank(format, size.width, size.height);
    return image.bytes.data();
  });
  if (!done) return tl::unexpected(done.error());
  return image;
}

std::uint8_t clampByte(int value) { return static_cast<std::uint8_t>(std::clamp(value, 0, 255)); }

// Full size, plain source to plain target.
Image convert(const Image& source, PixelFormat format) {
  Image image = blank(format, source.width, source.height);
  const auto stride = static_cast<std::size_t>(source.stride);
  const int red = format == PixelFormat::Bgr8 ? 2 : 0;
  for (int y = 0; y < source.height; ++y) {
    const std::uint8_t* in = source.bytes.data() + static_cast<std::size_t>(y) * stride;
    std::uint8_t* out =
        image.bytes.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(image.stride);
    const std::uint8_t* chroma =
        source.bytes.data() + static_cast<std::size_t>(source.height + y / 2) * stride;  // Nv12 only
    for (int x = 0; x < source.width; ++x) {
      int r = 0, g = 0, b = 0;
      switch (source.format) {
        case PixelFormat::Grey8:
          r = g = b = in[x];
          break;
        case PixelFormat::Rgb8:
          r = in[3 * x], g = in[3 * x + 1], b = in[3 * x + 2];
          break;
        case PixelFormat::Bgr8:
          b = in[3 * x], g = in[3 * x + 1], r = in[3 * x + 2];
          break;
        case PixelFormat::Nv12: {
          const int luma = in[x], u = chroma[x / 2 * 2] - 128, v = chroma[x / 2 * 2 + 1] - 128;
          if (format == PixelFormat::Grey8) {
            r = g = b = luma;
          } else {  // BT.601, 16 fractional bits
            r = clampByte(luma + ((91881 * v + 32768) >> 16));
            g = clampByte(luma - ((22554 * u + 46802 * v + 32768) >> 16));
            b = clampByte(luma + ((116130 * u + 32768) >> 16));
          }
          break;
        }
        case PixelFormat::Jpeg:
          break;
      }
      if (format == PixelFormat::Grey8) {
        const bool grey = source.format == PixelFormat::Grey8 || source.format == PixelFormat::Nv12;
        out[x] = grey ? static_cast<std::uint8_t>(r)
                      : static_cast<std::uint8_t>((19595 * r + 38470 * g + 7471 * b + 32768) >> 16);
      } else {
        out[3 * x + red] = static_cast<std::uint8_t>(r);
        out[3 * x + 1] = static_cast<std::uint8_t>(g);
        out[3 * x + 2 - red] = static_cast<std::uint8_t>(b);
      }
    }
  }
  return image;
}

Image shrink(const Image& source, int divide) {
  Image image =
      blank(source.format, (source.width + divide - 1) / divide, (source.height + divide - 1) / divide);
  const int channels = channelsOf(source.format);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.stride; ++x) {
      const int left = x / channels * divide, channel = x % channels;
      int sum = 0, count = 0;
      for (int j = y * divide; j < std::min((y + 1) * divide, source.height); ++j) {
        for (int i = left; i < std::min(left + divide, source.width); ++i, ++count) {
          sum += source.bytes[static_cast<std::size_t>(j) * static_cast<std::size_t>(source.stride) +
                              static_cast<std::size_t>(i * channels + channel)];
        }
      }
      image.bytes[static_cast<std::size_t>(y) * static_cast<std::size_t>(image.stride) +
                  static_cast<std::size_t>(x)] = static_cast<std::uint8_t>((sum + count / 2) / count);
    }
  }
  return image;
}

// Cells of kDivide x kDivide pixels of three bytes to words, averaged; rows are summed first, along memory.
template <int kDivide>
void shrinkToWords(const Image& image, bool blue_first, std::uint8_t* out) {
  const std::size_t red = blue_first ? 2 : 0, blue = 2 - red;
  const auto stride = static_cast<std::size_t>(image.stride);
  const int width = (image.width + kDivide - 1) / kDivide, height = (image.height + kDivide - 1) / kDivide;
  std::vector<std::uint16_t> sums(3 * static_cast<std::size_t>(image.width));
  const auto cell = [&](int columns, int rows, const std::uint16_t* sum) {
    unsigned total[3] = {0, 0, 0};
    for (int i = 0; i < columns; ++i, sum += 3)
      for (std::size_t c = 0; c < 3; ++c) total[c] += sum[c];
    const auto count = static_cast<unsigned>(rows * columns);
    out[0] = static_cast<std::uint8_t>((total[red] + count / 2) / count);
    out[1] = static_cast<std::uint8_t>((total[1] + count / 2) / count);
    out[2] = static_cast<std::uint8_t>((total[blue] + count / 2) / count);
    out[3] = 0;
    out += 4;
  };
  for (int y = 0; y < height; ++y) {
    const int rows = std::min(kDivide, image.height - y * kDivide);
    const std::uint8_t* in = image.bytes.data() + static_cast<std::size_t>(y * kDivide) * stride;
    std::copy_n(in, sums.size(), sums.begin());
    for (int j = 1; j < rows; ++j) {
      in += stride;
      for (std::size_t i = 0; i < sums.size(); ++i) sums[i] = static_cast<std::uint16_t>(sums[i] + in[i]);
    }
    const std::uint16_t* sum = sums.data();
    // Whole cells: the compiler knows their size.
    const int whole = rows == kDivide ? image.width / kDivide : 0;
    for (int x = 0; x < whole; ++x, sum += 3 * kDivide) cell(kDivide, kDivide, sum);
    for (int x = whole; x < width; ++x, sum += 3 * kDivide)
      cell(std::min(kDivide, image.width - x * kDivide), rows, sum);
  }
}

}  // namespace

Result<ImageSize> jpegSize(std::span<const std::uint8_t> jpeg) {
  if (jpeg.empty()) return fail(ErrorCode::BadInput, "not a readable JPEG: it is empty");
  const Handle decoder(tjInitDecompress());
  if (!decoder) return fail(ErrorCode::Internal, "libjpeg-turbo does not start");
  return readHeader(decoder.get(), jpeg);
}

std::optional<std::string> problemOf(const Image& image) {
  if (image.bytes.empty()) return "the image is empty";
  if (image.format == PixelFormat::Jpeg) return std::nullopt;
  if (image.width < 1 || image.height < 1 || std::int64_t{image.width} * image.height > kMaxPixels) {
    return fmt::format("{}x{} is not an image size", image.width, image.height);
  }
  const bool nv12 = image.format == PixelFormat::Nv12;
  const std::int64_t row =
      nv12 ? (image.width + 1) / 2 * 2 : std::int64_t{image.width} * channelsOf(image.format);
  if (image.stride < row) {
    return fmt::format("a stride of {} bytes is less than the {} of a row", image.stride, row);
  }
  const std::int64_t rows = nv12 ? image.height + (image.height + 1) / 2 : image.height;
  // The last row may end without its padding.
  const std::int64_t needed = image.stride * (rows - 1) + row;
  if (static_cast<std::int64_t>(image.bytes.size()) < needed) {
    return fmt::format("the image has {} bytes, {}x{} needs {}", image.bytes.size(), image.width,
                       image.height, needed);
  }
  return std::nullopt;
}

Result<Image> decodeImage(const Image& image, PixelFormat format, int divide) {
  if (format == PixelFormat::Jpeg || format == PixelFormat::Nv12) {
    return fail(ErrorCode::Unsupported, "images are decoded to Grey8, Rgb8 or Bgr8");
  }
  if (divide != 1 && divide != 2 && divide != 4 && divide != 8) {
    return fail(ErrorCode::Unsupported, fmt::format("images are divided by 1, 2, 4 or 8, not by {}", divide));
  }
  if (const auto problem = problemOf(image)) return fail(ErrorCode::BadInput, *problem);
  if (image.format == PixelFormat::Jpeg) return decodeJpeg(image, format, divide);
  Image plain = convert(image, format);
  return divide == 1 ? std::move(plain) : shrink(plain, divide);
}

Result<WordImage> decodeImageWords(const Image& image, int divide, std::vector<std::uint8_t>&& reuse) {
  if (divide != 1 && divide != 2 && divide != 4 && divide != 8)
    return fail(ErrorCode::Unsupported, fmt::format("images are divided by 1, 2, 4 or 8, not by {}", divide));
  if (const auto problem = problemOf(image)) return fail(ErrorCode::BadInput, *problem);
  WordImage words;
  words.rgbx = std::move(reuse);
  const auto allocate = [&words](const ImageSize& size) {
    words.width = size.width;
    words.height = size.height;
    words.rgbx.resize(4 * static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height));
    return words.rgbx.data();
  };
  if (image.format == PixelFormat::Jpeg) {
    if (auto done = decodeJpegInto(image, TJPF_RGBX, divide, allocate); !done)
      return tl::unexpected(done.error());
    return words;
  }
  if (image.format != PixelFormat::Rgb8 && image.format != PixelFormat::Bgr8) {
    const Image plain = convert(image, PixelFormat::Rgb8);
    return decodeImageWords(plain, divide, std::move(words.rgbx));
  }
  std::uint8_t* out = allocate({(image.width + divide - 1) / divide, (image.height + divide - 1) / divide});
  const bool blue_first = image.format == PixelFormat::Bgr8;
  if (divide == 1)
    shrinkToWords<1>(image, blue_first, out);
  else if (divide == 2)
    shrinkToWords<2>(image, blue_first, out);
  else if (divide == 4)
    shrinkToWords<4>(image, blue_first, out);
  else
    shrinkToWords<8>(image, blue_first, out);
  return words;
}

Result<Image> encodeJpeg(const Image& image, int quality) {
  if (const auto problem = problemOf(image)) return fail(ErrorCode::BadInput, *problem);
  if (image.format == PixelFormat::Jpeg) return fail(ErrorCode::Unsupported, "the image is a JPEG already");
  const Handle encoder(tjInitCompress());
  if (!encoder) return fail(ErrorCode::Internal, "libjpeg-turbo does not start");
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  int status = 0;
  if (image.format == PixelFormat::Nv12) {
    const int half_width = (image.width + 1) / 2, half_height = (image.height + 1) / 2;
    const std::size_t count = static_cast<std::size_t>(half_width) * static_cast<std::size_t>(half_height);
    std::vector<std::uint8_t> u(count), v(count);
    for (int y = 0; y < half_height; ++y) {
      const std::uint8_t* in = image.bytes.data() + static_cast<std::size_t>(image.height + y) *
                                                        static_cast<std::size_t>(image.stride);
      for (int x = 0; x < half_width; ++x) {
        const std::size_t at =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(half_width) + static_cast<std::size_t>(x);
        u[at] = in[2 * x];
        v[at] = in[2 * x + 1];
      }
    }
    const unsigned char* planes[3] = {image.bytes.data(), u.data(), v.data()};
    const int strides[3] = {image.stride, half_width, half_width};
    status = tjCompressFromYUVPlanes(encoder.get(), planes, image.width, strides, image.height, TJSAMP_420,
                                     &bytes, &size, quality, 0);
  } else {
    const int layout = image.format == PixelFormat::Grey8  ? TJPF_GRAY
                       : image.format == PixelFormat::Rgb8 ? TJPF_RGB
                                                           : TJPF_BGR;
    status =
        tjCompress2(encoder.get(), image.bytes.data(), image.width, image.stride, image.height, layout,
                    &bytes, &size, image.format == PixelFormat::Grey8 ? TJSAMP_GRAY : TJSAMP_420, quality, 0);
  }
  const std::unique_ptr<unsigned char, void (*)(unsigned char*)> owner(bytes, tjFree);
  if (status != 0) {
    return fail(ErrorCode::BadInput,
                fmt::format("the image does not compress: {}", tjGetErrorStr2(encoder.get())));
  }
  Image jpeg;
  jpeg.width = image.width;
  jpeg.height = image.height;
  jpeg.bytes.assign(bytes, bytes + size);
  return jpeg;
}

}  // namespace overfly::capture
