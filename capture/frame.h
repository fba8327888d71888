#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "capture/camera_model.h"
#include "capture/pose.h"

namespace overfly::capture {

enum class PixelFormat { Grey8, Nv12, Rgb8, Bgr8, Jpeg };

// Where a flight's or map's heights are counted from. Home and Unknown pass through unshifted, and an
// export then names no vertical reference.
enum class VerticalDatum { Unknown, Ellipsoid, Geoid, Home };

// One picture as the camera gave it. Jpeg stays encoded until somebody needs pixels.
struct Image {
  PixelFormat format = PixelFormat::Jpeg;
  int width = 0;  // pixels; for Jpeg what the header says (0 when it could not be read)
  int height = 0;
  int stride = 0;                   // bytes per row of the first plane; 0 for Jpeg
  std::vector<std::uint8_t> bytes;  // Nv12: Y plane, then interleaved UV plane of the same stride
};

// What happened to one shutter release. Immutable once handed on; share it as shared_ptr<const Frame>.
struct Frame {
  std::uint64_t sequence = 0;      // counts up within one source, gaps mean lost frames
  std::string name;                // file name without folder, or "%08u.jpg" for live frames
  std::string camera_id;           // names the CameraModel within the flight
  std::int64_t time_ns = 0;        // middle of the exposure, CLOCK_BOOTTIME, nanoseconds
  std::int64_t time_sigma_ns = 0;  // of time_ns, 1 sigma; a pose's covariance holds it already
  std::int64_t utc_offset_ns = 0;  // add to time_ns for UTC (Unix epoch, nanoseconds)
  std::int64_t exposure_ns = 0;    // 0: unknown
  double gain = 0;                 // linear sensor gain; 0: unknown
  Image image;
  CameraModel camera;
  std::optional<Pose> pose;                      // absent: recorded, not mapped until one arrives
  std::string no_pose_reason;                    // while it is absent: a few fixed words, to be counted by
  bool pose_is_adjusted = false;                 // true: came from a bundle adjustment and is kept as it is
  VerticalDatum datum = VerticalDatum::Unknown;  // of the pose's height
};
using FramePtr = std::shared_ptr<const Frame>;

}  // namespace overfly::capture
