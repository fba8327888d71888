#pragma once
#include <functional>
#include <memory>

#include "capture/frame.h"
#include "config/error.h"
#include "tiling/rectify/pinned_lru.h"
#include "tiling/rectify/rectifier.h"

namespace overfly::tiling {

using RectifiedPtr = std::shared_ptr<const RectifiedFrame>;

struct FrameCacheStats {
  std::uint64_t hits = 0;
  std::uint64_t misses = 0;
  std::uint64_t uploads = 0;  // misses that ended with a frame on the GPU
  std::uint64_t evictions = 0;
  std::size_t bytes = 0;
  std::size_t frames = 0;
  RectifyTimes times;  // sums over all uploads, seconds
};

// Rectified frames in GPU memory within a byte budget. A frame is pinned while somebody holds its pointer.
// Thread-bound to the Rectifier's GL context, as are the pointers.
class FrameCache {
 public:
  FrameCache(Rectifier rectifier, std::size_t budget_bytes)
      : rectifier_(std::move(rectifier)), frames_(budget_bytes) {}

  // `load` fetches the frame (from disk, or the one in memory) and is called on a miss only. A frame whose
  // `camera` differs from the cached one's is made again. Errors: load's and Rectifier's; GPU memory that
  // runs out frees everything that is not pinned and tries once more.
  [[nodiscard]] Result<RectifiedPtr> acquire(std::uint64_t id, const capture::CameraModel& camera,
                                             const std::function<Result<capture::FramePtr>()>& load);
  // For a frame that is in memory.
  [[nodiscard]] Result<RectifiedPtr> acquire(std::uint64_t id, const capture::FramePtr& frame) {
    return acquire(id, frame->camera, [&frame]() -> Result<capture::FramePtr> { return frame; });
  }

  void clear() { frames_.clear(); }
  [[nodiscard]] FrameCacheStats stats() const;

 private:
  Rectifier rectifier_;
  PinnedLru<RectifiedFrame> frames_;
  FrameCacheStats stats_;
};

}  // namespace overfly::tiling
