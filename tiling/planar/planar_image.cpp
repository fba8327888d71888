#include "tiling/planar/planar_image.h"

#include <fmt/format.h>

#include <cstdlib>
#include <utility>

#include "capture/image_decode.h"

namespace overfly::tiling {

Result<PlanarImage> decodeForPlane(const capture::Frame& frame, double gsd_m, double texel_m,
                                   std::vector<std::uint8_t>&& reuse) {
  int reduction = 1;
  while (reduction < 8 && gsd_m * 2 * reduction <= texel_m) reduction *= 2;
  auto decoded = capture::decodeImageWords(frame.image, reduction, std::move(reuse));
  if (!decoded) return tl::unexpected(decoded.error());
  PlanarImage image;
  image.camera = frame.camera.scaled(1.0 / reduction);
  image.width = decoded->width;
  image.height = decoded->height;
  if (std::abs(image.camera.width - image.width) > 1 || std::abs(image.camera.height - image.height) > 1)
    return fail(ErrorCode::BadInput,
                fmt::format("{} is {} x {} pixels, its camera {} x {}", frame.name, image.width * reduction,
                            image.height * reduction, frame.camera.width, frame.camera.height));
  image.rgbx = std::move(decoded->rgbx);
  return image;
}

}  // namespace overfly::tiling
