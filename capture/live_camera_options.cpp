#include "capture/live_camera_options.h"

#include <fmt/format.h>

#include <cmath>

namespace overfly::capture {

const char* nameOf(LiveCameraOptions::Format format) {
  switch (format) {
    case LiveCameraOptions::Format::Auto:
      return "auto";
    case LiveCameraOptions::Format::Mjpeg:
      return "mjpeg";
    case LiveCameraOptions::Format::Nv12:
      return "nv12";
    case LiveCameraOptions::Format::Yuyv:
      return "yuyv";
    case LiveCameraOptions::Format::Grey:
      return "grey";
    case LiveCameraOptions::Format::Rgb:
      return "rgb";
    case LiveCameraOptions::Format::Bayer8:
      return "bayer8";
    case LiveCameraOptions::Format::Bayer10:
      return "bayer10";
  }
  return "";
}

Result<CameraModel> lensFor(const CameraModel& lens, int width, int height) {
  if (lens.width == width && lens.height == height) return lens;
  const double factor = static_cast<double>(width) / lens.width;
  // Sizes are whole pixels: a binned sensor may lose a row.
  if (std::abs(factor * lens.height - height) > 1) {
    return fail(ErrorCode::Unsupported,
                fmt::format("camera.model_file is for {}x{} pixels and the camera gives {}x{}, which is "
                            "another shape: set camera.width_px and camera.height_px, or calibrate this size",
                            lens.width, lens.height, width, height));
  }
  CameraModel scaled = lens.scaled(factor);
  scaled.width = width;
  scaled.height = height;
  return scaled;
}

}  // namespace overfly::capture
