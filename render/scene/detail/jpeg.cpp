#include "render/scene/detail/jpeg.h"

#include <turbojpeg.h>

#include <memory>

namespace overfly::scene {

Result<std::vector<std::uint8_t>> encodeJpeg(const Picture& picture, int quality, bool half_chroma) {
  const std::unique_ptr<void, int (*)(tjhandle)> compressor(tjInitCompress(), tjDestroy);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  const int failed =
      tjCompress2(compressor.get(), picture.rgb.data(), picture.width, 0, picture.height, TJPF_RGB, &bytes,
                  &size, half_chroma ? TJSAMP_420 : TJSAMP_444, quality, TJFLAG_ACCURATEDCT);
  const std::unique_ptr<unsigned char, void (*)(unsigned char*)> owner(bytes, tjFree);
  if (failed != 0)
    return fail(ErrorCode::Internal,
                std::string("a frame cannot be compressed: ") + tjGetErrorStr2(compressor.get()));
  return std::vector<std::uint8_t>(bytes, bytes + size);
}

}  // namespace overfly::scene
