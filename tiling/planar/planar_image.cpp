#include "tiling/planar/planar_image.h"

#include <fmt/format.h>

#include <cstdlib>

#include "capture/image_decode.h"

namespace overfly::tiling {

Result<PlanarImage> decodeForPlane(const capture::Frame& frame, double gsd_m, double texel_m) {
  int reduction = 1;
  while (reduction < 8 && gsd_m * 2 * reduction <= texel_m) reduction *= 2;
  auto decoded = capture::decodeImage(frame.image, capture::PixelFormat::Rgb8, reduction);
  if (!decoded) return tl::unexpected(decoded.error());
  PlanarImage image;
  image.camera = frame.camera.scaled(1.0 / reduction);
  image.width = decoded->width;
  image.height = decoded->height;
  if (std::abs(image.camera.width - image.width) > 1 || std::abs(image.camera.height - image.height) > 1)
    return fail(ErrorCode::BadInput,
                fmt::format("{} is {} x {} pixels, its camera {} x {}", frame.name, image.width * reduction,
                            image.height * reduction, frame.camera.width, frame.camera.height));
  const std::size_t count = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  image.rgbx.resize(4 * count);
  const std::uint8_t* in = decoded->bytes.data();
  std::uint8_t* out = image.rgbx.data();
  for (std::size_t i = 0; i < count; ++i, in += 3, out += 4) {
    out[0] = in[0];
    out[1] = in[1];
    out[2] = in[2];
  }
  return image;
}

}  // namespace overfly::tiling
