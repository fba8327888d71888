#pragma once
#include <cstdint>
#include <string>

#include "capture/camera_model.h"
#include "config/error.h"

namespace overfly::capture {

// How a live camera is to take pictures; the same for V4L2 and libcamera. Zero leaves it to the camera.
struct LiveCameraOptions {
  // Auto: what costs the least to take at the size asked for, in the order JPEG, NV12, YUYV, RGB, raw Bayer,
  // grey.
  enum class Format { Auto, Mjpeg, Nv12, Yuyv, Grey, Rgb, Bayer8, Bayer10 };

  std::string device;  // device node, or libcamera's id or model; empty: the first camera that there is
  std::string camera_id = "cam0";  // Frame::camera_id
  // The lens. A frame of the same shape but another size gets the scaled model; one of another shape is
  // refused when the camera is opened.
  CameraModel lens;
  Format format = Format::Auto;
  int width = 0;  // pixels; 0: the largest
  int height = 0;
  double rate_fps = 0;
  std::int64_t exposure_ns = 0;  // 0: automatic
  double gain = 0;               // 0: automatic
  double lens_position_dpt = 0;  // focus, dioptres; 0: infinity
  // From the first row's exposure to the last one's; 0: global shutter. Half of it moves Frame::time_ns from
  // the driver's stamp to the middle row.
  std::int64_t rolling_shutter_ns = 0;
  int buffers = 6;  // asked of the driver: so many frames may wait while one is recorded
};

[[nodiscard]] const char* nameOf(LiveCameraOptions::Format format);

// The lens for frames of this size. Unsupported: the model is of another shape.
[[nodiscard]] Result<CameraModel> lensFor(const CameraModel& lens, int width, int height);

}  // namespace overfly::capture
