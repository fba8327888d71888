#include <fmt/format.h>

#include <cmath>

#include "capture/import/camera_file.h"
#include "capture/v4l2/v4l2_source.h"
#include "daemon/overflyd/live.h"
#ifdef OVERFLY_HAS_LIBCAMERA
#include "capture/libcamera/libcamera_source.h"
#endif

namespace overfly::daemon {
namespace {

using Format = capture::LiveCameraOptions::Format;

Format formatFrom(config::CameraFormat format) {
  switch (format) {
    case config::CameraFormat::Auto:
      return Format::Auto;
    case config::CameraFormat::Mjpeg:
      return Format::Mjpeg;
    case config::CameraFormat::Nv12:
      return Format::Nv12;
    case config::CameraFormat::Yuyv:
      return Format::Yuyv;
    case config::CameraFormat::Grey:
      return Format::Grey;
    case config::CameraFormat::Rgb:
      return Format::Rgb;
    case config::CameraFormat::Bayer8:
      return Format::Bayer8;
    case config::CameraFormat::Bayer10:
      return Format::Bayer10;
  }
  return Format::Auto;
}

Result<capture::LiveCameraOptions> optionsFrom(const config::Settings& settings) {
  const config::Camera& camera = settings.camera;
  if (camera.model_file.empty())
    return fail(ErrorCode::BadSettings,
                "camera.model_file is empty: a live camera needs a JSON file with its width, height, fx, fy, "
                "cx and cy in pixels (docs/live-sources.md)");
  const auto file = capture::readCameraFile(camera.model_file);
  if (!file) return fail(ErrorCode::BadSettings, "camera.model_file: " + file.error().message);
  capture::LiveCameraOptions options;
  options.device = settings.source.path;
  options.camera_id = camera.id;
  options.lens = file->model;
  options.format = formatFrom(camera.format);
  options.width = camera.width_px;
  options.height = camera.height_px;
  options.rate_fps = camera.rate_fps;
  options.exposure_ns = std::int64_t{camera.exposure_us} * 1'000;
  options.gain = camera.gain;
  options.lens_position_dpt = camera.lens_position_dpt;
  options.rolling_shutter_ns = std::llround(camera.rolling_shutter_ms * 1e6);
  options.buffers = camera.buffers;
  return options;
}

}  // namespace

Result<std::unique_ptr<capture::CameraSource>> makeCamera(const config::Settings& settings) {
  auto options = optionsFrom(settings);
  if (!options) return tl::unexpected(options.error());
  if (settings.source.kind == config::SourceKind::V4l2)
    return std::make_unique<capture::V4l2Source>(std::move(*options));
#ifdef OVERFLY_HAS_LIBCAMERA
  return std::make_unique<capture::LibcameraSource>(std::move(*options));
#else
  return fail(ErrorCode::BadSettings,
              "source.kind: this build is without libcamera (libcamera-dev was not there); allowed: replay, "
              "scene, v4l2");
#endif
}

}  // namespace overfly::daemon
