#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "capture/camera_model.h"
#include "capture/frame.h"
#include "capture/geo/footprint.h"
#include "capture/pose.h"
#include "tiling/plane_box.h"

namespace overfly::tiling {

enum class FrameState : std::uint8_t {
  Recorded = 0,  // known, not used for a tile yet
  Mapped = 1,    // used by at least one tile
  Refused = 2,   // cannot be used; `reason` says why
  Dropped = 3,   // its image file was removed to keep the disk budget; its tiles stay
};

// What the map knows of a frame. The image itself stays in the recorded flight, at `path`.
struct FrameRecord {
  std::uint64_t id = 0;  // the number that a tile's frame set holds; unique in the map
  std::string name;
  std::string camera_id;
  capture::CameraModel camera;
  std::optional<capture::Pose> pose;
  bool pose_is_adjusted = false;
  capture::VerticalDatum datum = capture::VerticalDatum::Unknown;
  std::int64_t time_ns = 0;        // middle of the exposure, CLOCK_BOOTTIME
  std::int64_t utc_offset_ns = 0;  // add to time_ns for UTC
  std::int64_t exposure_ns = 0;
  std::optional<geo::Footprint> footprint;  // absent for oblique frames and frames without a pose
  std::optional<PlaneBox> box;              // the footprint's bounds in the map's plane
  std::string path;                         // of the image, relative to the map's folder or absolute
  std::uint64_t bytes = 0;                  // of the image file; counts against the disk budget
  FrameState state = FrameState::Recorded;
  std::string reason;  // for Refused
};

}  // namespace overfly::tiling
