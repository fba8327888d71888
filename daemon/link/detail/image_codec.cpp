#include "daemon/link/detail/image_codec.h"

#include <png.h>
#include <turbojpeg.h>
#include <webp/encode.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <memory>

namespace overfly::link {

std::string encodePng(const Rgba& image) {
  // The full interface rather than png_image: the simplified one offers no compression level.
  std::string out;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  if (!png) return out;
  png_infop info = png_create_info_struct(png);
  if (!info || setjmp(png_jmpbuf(png))) {  // NOLINT: libpng's error path
    png_destroy_write_struct(&png, &info);
    return {};
  }
  png_set_write_fn(
      png, &out,
      [](png_structp p, png_bytep data, png_size_t size) {
        static_cast<std::string*>(png_get_io_ptr(p))->append(reinterpret_cast<const char*>(data), size);
      },
      nullptr);
  png_set_IHDR(png, info, static_cast<png_uint_32>(image.width), static_cast<png_uint_32>(image.height), 8,
               PNG_COLOR_TYPE_RGB_ALPHA, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  png_set_compression_level(png, 4);
  png_write_info(png, info);
  for (int y = 0; y < image.height; ++y) png_write_row(png, image.at(0, y));
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  return out;
}

std::string encodeWebp(const Rgba& image, int quality) {
  WebPConfig config;
  WebPPicture picture;
  if (!WebPConfigInit(&config) || !WebPPictureInit(&picture)) return {};
  if (quality > 100) {
    WebPConfigLosslessPreset(&config, 1);
    config.exact = 1;
  } else {
    config.quality = static_cast<float>(quality);
    config.method = 2;
  }
  picture.use_argb = 1;
  picture.width = image.width;
  picture.height = image.height;
  WebPMemoryWriter writer;
  WebPMemoryWriterInit(&writer);
  picture.writer = WebPMemoryWrite;
  picture.custom_ptr = &writer;
  std::string out;
  if (WebPPictureImportRGBA(&picture, image.texels.data(), image.width * 4) && WebPEncode(&config, &picture))
    out.assign(reinterpret_cast<const char*>(writer.mem), writer.size);
  WebPPictureFree(&picture);
  WebPMemoryWriterClear(&writer);
  return out;
}

std::string encodeJpeg(const Rgba& image, int quality) {
  std::vector<std::uint8_t> flat(image.texels.size() / 4 * 3);
  for (std::size_t i = 0; i < flat.size() / 3; ++i) {
    const auto* from = image.texels.data() + 4 * i;
    for (std::size_t c = 0; c < 3; ++c)
      flat[3 * i + c] = static_cast<std::uint8_t>((from[c] * from[3] + 255 * (255 - from[3]) + 127) / 255);
  }
  const std::unique_ptr<void, int (*)(void*)> jpeg(tjInitCompress(), tjDestroy);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  std::string out;
  if (jpeg && tjCompress2(jpeg.get(), flat.data(), image.width, 0, image.height, TJPF_RGB, &bytes, &size,
                          TJSAMP_420, quality, 0) == 0)
    out.assign(reinterpret_cast<const char*>(bytes), size);
  tjFree(bytes);
  return out;
}

namespace {

// Holes filled from a pyramid: each level's texel is the mean of its valid children, and a hole takes the
// finest level's value that has one.
void fillHoles(Heights& heights, float fill_m) {
  if (std::ranges::none_of(heights.texels, [](float h) { return std::isnan(h); })) return;
  std::vector<Heights> levels{heights};
  while (levels.back().width > 1 || levels.back().height > 1) {
    const auto& fine = levels.back();
    Heights coarse((fine.width + 1) / 2, (fine.height + 1) / 2);
    for (int y = 0; y < coarse.height; ++y)
      for (int x = 0; x < coarse.width; ++x) {
        float sum = 0;
        int count = 0;
        for (int i = 0; i < 4; ++i) {
          const int fx = std::min(2 * x + (i & 1), fine.width - 1),
                    fy = std::min(2 * y + (i >> 1), fine.height - 1);
          const float h = fine.at(fx, fy);
          if (std::isnan(h)) continue;
          sum += h;
          ++count;
        }
        if (count > 0) coarse.at(x, y) = sum / static_cast<float>(count);
      }
    levels.push_back(std::move(coarse));
  }
  for (int y = 0; y < heights.height; ++y)
    for (int x = 0; x < heights.width; ++x) {
      auto& h = heights.at(x, y);
      for (std::size_t l = 1; std::isnan(h) && l < levels.size(); ++l) h = levels[l].at(x >> l, y >> l);
      if (std::isnan(h)) h = fill_m;
    }
}

}  // namespace

Rgba terrarium(const Heights& heights, float fill_m) {
  Heights whole = heights;
  fillHoles(whole, fill_m);
  Rgba out(heights.width, heights.height);
  for (std::size_t i = 0; i < whole.texels.size(); ++i) {
    const double steps =
        std::clamp(std::round((static_cast<double>(whole.texels[i]) + 32768.0) * 256.0), 0.0, 16777215.0);
    const auto value = static_cast<std::uint32_t>(steps);
    auto* texel = out.texels.data() + 4 * i;
    texel[0] = static_cast<std::uint8_t>(value >> 16);
    texel[1] = static_cast<std::uint8_t>(value >> 8 & 255);
    texel[2] = static_cast<std::uint8_t>(value & 255);
    texel[3] = 255;
  }
  return out;
}

// TIFF 6.0, little-endian, one strip; georeference after OGC GeoTIFF 1.1 (ModelPixelScale, ModelTiepoint,
// GeoKeyDirectory), no-data as GDAL's ASCII tag 42113.
std::string encodeGeoTiff(const Heights& heights, double west_m, double north_m, double texel_m) {
  static_assert(std::endian::native == std::endian::little);
  struct Entry {
    std::uint16_t tag, type;
    std::uint32_t count, value;
  };
  constexpr std::uint16_t kAscii = 2, kShort = 3, kLong = 4, kDouble = 12;
  constexpr std::uint32_t kEntries = 15;
  constexpr std::uint32_t kDirectory = 8, kAfter = kDirectory + 2 + kEntries * 12 + 4;
  constexpr std::uint32_t kScaleAt = (kAfter + 7) / 8 * 8, kTieAt = kScaleAt + 24, kKeysAt = kTieAt + 48,
                          kKeys = 4 * 4, kPixelsAt = (kKeysAt + kKeys * 2 + 15) / 16 * 16;
  const auto width = static_cast<std::uint32_t>(heights.width),
             height = static_cast<std::uint32_t>(heights.height);
  const std::uint32_t bytes = width * height * 4;
  const Entry entries[kEntries] = {
      {256, kLong, 1, width},
      {257, kLong, 1, height},
      {258, kShort, 1, 32},
      {259, kShort, 1, 1},  // no compression
      {262, kShort, 1, 1},  // black is zero
      {273, kLong, 1, kPixelsAt},
      {277, kShort, 1, 1},
      {278, kLong, 1, height},
      {279, kLong, 1, bytes},
      {284, kShort, 1, 1},
      {339, kShort, 1, 3},  // IEEE floating point
      {33550, kDouble, 3, kScaleAt},
      {33922, kDouble, 6, kTieAt},
      {34735, kShort, kKeys, kKeysAt},
      {42113, kAscii, 4, 0x006e616e},  // "nan"
  };
  const double scale[3] = {texel_m, texel_m, 0};
  const double tie[6] = {0, 0, 0, west_m, north_m, 0};
  // version 1.1.0, 3 keys: GTModelType projected, GTRasterType area, ProjectedCRS 3857
  const std::uint16_t keys[kKeys] = {1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 3857};
  std::string out(kPixelsAt + bytes, '\0');
  const auto put = [&](std::size_t at, const void* from, std::size_t size) {
    std::memcpy(out.data() + at, from, size);
  };
  const std::uint16_t magic[2] = {0x4949, 42};
  const std::uint32_t first = kDirectory;
  const std::uint16_t count = kEntries;
  put(0, magic, 4);
  put(4, &first, 4);
  put(kDirectory, &count, 2);
  for (std::uint32_t i = 0; i < kEntries; ++i) {
    const std::size_t at = kDirectory + 2 + i * 12;
    put(at, &entries[i].tag, 2);
    put(at + 2, &entries[i].type, 2);
    put(at + 4, &entries[i].count, 4);
    put(at + 8, &entries[i].value, 4);
  }
  put(kScaleAt, scale, sizeof scale);
  put(kTieAt, tie, sizeof tie);
  put(kKeysAt, keys, sizeof keys);
  put(kPixelsAt, heights.texels.data(), bytes);
  return out;
}

}  // namespace overfly::link
