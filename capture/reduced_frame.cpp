#include "capture/reduced_frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "capture/image_decode.h"

namespace overfly::capture {

Result<FramePtr> reduced(const Frame& frame, int divide) {
  if (divide != 1 && divide != 2 && divide != 4 && divide != 8)
    return fail(ErrorCode::BadInput, fmt::format("frames are reduced by 1, 2, 4 or 8, not by {}", divide));
  auto image = decodeImage(frame.image, PixelFormat::Rgb8, divide);
  if (!image) return tl::unexpected(image.error());
  auto out = std::make_shared<Frame>();
  *out = frame;
  out->camera = frame.camera.scaled(1.0 / divide);
  out->camera.width = frame.camera.width / divide;
  out->camera.height = frame.camera.height / divide;
  if (out->camera.width < 1 || out->camera.height < 1)
    return fail(ErrorCode::BadInput, fmt::format("{} has too few pixels to be reduced", frame.name));
  // The decoder rounds up: what stands over is of a part of a pixel.
  if (image->width < out->camera.width || image->height < out->camera.height)
    return fail(ErrorCode::BadInput, fmt::format("{} is not of its camera's size", frame.name));
  out->image.format = PixelFormat::Rgb8;
  out->image.width = out->camera.width;
  out->image.height = out->camera.height;
  out->image.stride = 3 * out->camera.width;
  out->image.bytes.resize(static_cast<std::size_t>(out->image.stride) *
                          static_cast<std::size_t>(out->image.height));
  for (int y = 0; y < out->image.height; ++y)
    std::copy_n(image->bytes.begin() + static_cast<std::ptrdiff_t>(y) * image->stride, out->image.stride,
                out->image.bytes.begin() + static_cast<std::ptrdiff_t>(y) * out->image.stride);
  return FramePtr(std::move(out));
}

}  // namespace overfly::capture
