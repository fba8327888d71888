#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "capture/image_decode.h"
#include "capture/import/jpeg_tags.h"

// Any bytes as a drone's JPEG: EXIF, XMP, and the picture itself.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace overfly::capture;
  static const std::filesystem::path file =
      std::filesystem::temp_directory_path() / ("overfly_fuzz_" + std::to_string(getpid()) + ".jpg");
  {
    std::ofstream out(file, std::ios::binary | std::ios::trunc);
    out.write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  }
  const auto tags = readJpegTags(file);
  if (!tags && tags.error().message.empty()) std::abort();
  if (tags && tags->camera && tags->camera->problem()) std::abort();
  Image image;
  image.bytes.assign(data, data + size);
  const auto pixels = decodeImage(image, PixelFormat::Grey8);
  if (!pixels && pixels.error().message.empty()) std::abort();
  std::error_code ignored;
  std::filesystem::remove(file, ignored);
  return 0;
}
