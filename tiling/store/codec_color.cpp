#include "tiling/store/codec_color.h"

#include <fmt/format.h>
#include <turbojpeg.h>
#include <webp/decode.h>
#include <webp/encode.h>

#include <algorithm>
#include <cstring>
#include <memory>

namespace overfly::tiling {
namespace {

using JpegHandle = std::unique_ptr<void, int (*)(tjhandle)>;

tjhandle jpegCompressor() {
  thread_local const JpegHandle handle(tjInitCompress(), &tjDestroy);
  return handle.get();
}
tjhandle jpegDecompressor() {
  thread_local const JpegHandle handle(tjInitDecompress(), &tjDestroy);
  return handle.get();
}

std::size_t texels(int size) { return static_cast<std::size_t>(size) * static_cast<std::size_t>(size); }

Result<std::vector<std::uint8_t>> encodeJpeg(std::span<const std::uint8_t> rgba, int size, int quality) {
  // As long as the worst case, far longer than what comes out: kept for the next tile, not handed on with it.
  thread_local std::vector<std::uint8_t> room;
  room.resize(std::max<std::size_t>(room.size(), tjBufSize(size, size, TJSAMP_420)));
  unsigned char* at = room.data();
  unsigned long length = room.size();
  if (tjCompress2(jpegCompressor(), rgba.data(), size, 0, size, TJPF_RGBA, &at, &length, TJSAMP_420, quality,
                  TJFLAG_NOREALLOC) != 0)
    return fail(ErrorCode::Internal, fmt::format("JPEG: {}", tjGetErrorStr2(jpegCompressor())));
  return std::vector<std::uint8_t>(at, at + length);
}

Result<std::vector<std::uint8_t>> encodeWebp(std::span<const std::uint8_t> rgba, int size,
                                             const ColorCoding& coding) {
  WebPConfig config;
  WebPPicture picture;
  if (WebPConfigPreset(&config, WEBP_PRESET_PHOTO, static_cast<float>(coding.quality)) == 0 ||
      WebPPictureInit(&picture) == 0)
    return fail(ErrorCode::Unsupported, "libwebp is of another version than its headers");
  config.method = coding.webp_method;
  config.alpha_quality = 100;  // lossless
  config.alpha_compression = 1;
  config.alpha_filtering = 1;
  picture.width = picture.height = size;
  std::unique_ptr<WebPPicture, decltype(&WebPPictureFree)> free_picture(&picture, &WebPPictureFree);
  WebPMemoryWriter writer;
  WebPMemoryWriterInit(&writer);
  std::unique_ptr<WebPMemoryWriter, decltype(&WebPMemoryWriterClear)> free_writer(&writer,
                                                                                  &WebPMemoryWriterClear);
  picture.writer = WebPMemoryWrite;
  picture.custom_ptr = &writer;
  if (WebPPictureImportRGBA(&picture, rgba.data(), 4 * size) == 0 || WebPEncode(&config, &picture) == 0)
    return fail(ErrorCode::Internal, fmt::format("WebP: error {}", static_cast<int>(picture.error_code)));
  return std::vector<std::uint8_t>(writer.mem, writer.mem + writer.size);
}

}  // namespace

Result<CodedColor> encodeColor(std::span<const std::uint8_t> rgba, int size, const ColorCoding& coding) {
  if (size < 1 || size > 4096 || rgba.size() != 4 * texels(size))
    return fail(ErrorCode::BadInput,
                fmt::format("{} bytes are no RGBA picture of side {}", rgba.size(), size));
  if (coding.quality < 1 || coding.quality > 100 || coding.webp_method < 0 || coding.webp_method > 6)
    return fail(ErrorCode::BadInput, "the quality of colour tiles must be 1 to 100, the WebP method 0 to 6");
  bool opaque = coding.format == ColorFormat::Auto;
  for (std::size_t i = 0; opaque && i < texels(size); ++i) opaque = rgba[4 * i + 3] == 255;
  auto bytes = opaque ? encodeJpeg(rgba, size, coding.quality) : encodeWebp(rgba, size, coding);
  if (!bytes) return tl::unexpected(bytes.error());
  return CodedColor{opaque ? Codec::Jpeg : Codec::Webp, std::move(*bytes)};
}

Result<std::vector<std::uint8_t>> decodeColor(Codec codec, std::span<const std::uint8_t> bytes, int size) {
  const auto damaged = [] { return fail(ErrorCode::Corrupt, "the coded colours are damaged"); };
  if (size < 1 || size > 4096) return damaged();
  std::vector<std::uint8_t> rgba(4 * texels(size));
  if (codec == Codec::Jpeg) {
    int width = 0, height = 0, subsampling = 0, space = 0;
    if (tjDecompressHeader3(jpegDecompressor(), bytes.data(), bytes.size(), &width, &height, &subsampling,
                            &space) != 0 ||
        width != size || height != size ||
        tjDecompress2(jpegDecompressor(), bytes.data(), bytes.size(), rgba.data(), size, 0, size, TJPF_RGBA,
                      TJFLAG_STOPONWARNING) != 0)
      return damaged();
    return rgba;
  }
  if (codec != Codec::Webp) return damaged();
  int width = 0, height = 0;
  if (WebPGetInfo(bytes.data(), bytes.size(), &width, &height) == 0 || width != size || height != size ||
      WebPDecodeRGBAInto(bytes.data(), bytes.size(), rgba.data(), rgba.size(), 4 * size) == nullptr)
    return damaged();
  for (std::size_t i = 0; i < texels(size); ++i)
    if (rgba[4 * i + 3] == 0) std::memset(rgba.data() + 4 * i, 0, 4);
  return rgba;
}

}  // namespace overfly::tiling
