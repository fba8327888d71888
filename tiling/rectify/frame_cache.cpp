#include "tiling/rectify/frame_cache.h"

namespace overfly::tiling {

Result<RectifiedPtr> FrameCache::acquire(std::uint64_t id, const capture::CameraModel& camera,
                                         const std::function<Result<capture::FramePtr>()>& load) {
  if (RectifiedPtr known = frames_.find(id); known && known->camera == camera) {
    ++stats_.hits;
    return known;
  }
  ++stats_.misses;
  const auto frame = load();
  if (!frame) return tl::unexpected(frame.error());
  auto made = rectifier_.rectify(id, **frame);
  if (!made && made.error().code == ErrorCode::Unavailable && frames_.size() > 0) {
    frames_.clear();
    made = rectifier_.rectify(id, **frame);
  }
  if (!made) return tl::unexpected(made.error());
  ++stats_.uploads;
  stats_.times.decode_s += made->times.decode_s;
  stats_.times.upload_s += made->times.upload_s;
  stats_.times.gpu_s += made->times.gpu_s;
  const std::size_t bytes = made->bytes();
  auto shared = std::make_shared<const RectifiedFrame>(std::move(*made));
  frames_.insert(id, shared, bytes);
  return shared;
}

FrameCacheStats FrameCache::stats() const {
  FrameCacheStats out = stats_;
  out.evictions = frames_.evictions();
  out.bytes = frames_.bytes();
  out.frames = frames_.size();
  return out;
}

}  // namespace overfly::tiling
