#include "tiling/store/make_frame_record.h"

namespace overfly::tiling {

FrameRecord makeFrameRecord(std::uint64_t id, const capture::Frame& frame) {
  FrameRecord record;
  record.id = id;
  record.name = frame.name;
  record.camera_id = frame.camera_id;
  record.camera = frame.camera;
  record.pose = frame.pose;
  record.pose_is_adjusted = frame.pose_is_adjusted;
  record.datum = frame.datum;
  record.time_ns = frame.time_ns;
  record.utc_offset_ns = frame.utc_offset_ns;
  record.exposure_ns = frame.exposure_ns;
  return record;
}

}  // namespace overfly::tiling
