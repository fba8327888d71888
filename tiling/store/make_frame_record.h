#pragma once
#include <cstdint>

#include "capture/frame.h"
#include "tiling/store/frame_record.h"

namespace overfly::tiling {

// What the map keeps of a frame itself; place, file and state are the caller's to add.
[[nodiscard]] FrameRecord makeFrameRecord(std::uint64_t id, const capture::Frame& frame);

}  // namespace overfly::tiling
