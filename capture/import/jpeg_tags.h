#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "capture/camera_model.h"
#include "capture/record/flight.h"
#include "config/error.h"

namespace overfly::capture {

// What a drone wrote into one JPEG.
struct JpegTags {
  int width = 0, height = 0;  // pixels
  std::string camera_name;    // make and model, "" when not written
  RawTelemetry raw;           // angles in the convention of geo::enuFromCamera (pitch -90 deg: straight down)
  std::optional<std::int64_t> local_time_ns;  // DateTimeOriginal with its sub-seconds, as if it were UTC
  std::optional<std::int64_t> zone_ns;  // local time less UTC: OffsetTimeOriginal, else from the GPS time
  std::int64_t exposure_ns = 0;
  bool rtk_fixed = false;                // drone-dji:RtkFlag 50
  bool altitude_is_ellipsoidal = false;  // said by EXIF GPSAltitudeRef 2/3 or pix4d's Camera:VertCS
  std::optional<CameraModel> camera;     // from the tags
  std::string camera_reason;             // where the camera's values came from
};

// BadInput: not a JPEG with metadata that reads; the message says what was the matter. Thread rule: one
// thread at a time (Exiv2's XMP reader).
[[nodiscard]] Result<JpegTags> readJpegTags(const std::filesystem::path& file);

}  // namespace overfly::capture
