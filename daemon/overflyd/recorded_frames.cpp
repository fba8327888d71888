#include "daemon/overflyd/recorded_frames.h"

#include <fmt/format.h>

namespace overfly::daemon {

Result<std::unique_ptr<RecordedFrames>> RecordedFrames::open(const std::filesystem::path& folder) {
  std::unique_ptr<RecordedFrames> frames(new RecordedFrames(folder));
  for (int part = 1;; ++part) {
    const std::filesystem::path path = folder / fmt::format("flight-{}", part);
    if (!std::filesystem::exists(path)) {
      frames->own_ = path;
      break;
    }
    auto flight = capture::Flight::open(path);
    // A folder that a kill left before its first frame was whole holds nothing to take up.
    if (!flight) continue;
    frames->first_id_ += flight->size();
    frames->parts_.push_back(std::move(*flight));
  }
  return frames;
}

Result<std::uint64_t> RecordedFrames::record(const capture::Frame& frame, const capture::FlightInfo& info) {
  const std::scoped_lock lock(mutex_);
  if (!recorder_) {
    auto created = capture::FlightRecorder::create(own_, info);
    if (!created) return tl::unexpected(created.error());
    recorder_.emplace(std::move(*created));
  }
  if (auto ok = recorder_->record(frame); !ok) return tl::unexpected(ok.error());
  return first_id_ + recorded_++;
}

Result<capture::FramePtr> RecordedFrames::load(std::uint64_t id) {
  const std::scoped_lock lock(mutex_);
  if (id < first_id_) {
    std::uint64_t index = id;
    for (const capture::Flight& part : parts_) {
      if (index < part.size()) return part.load(index);
      index -= part.size();
    }
  }
  const std::uint64_t index = id - first_id_;
  if (!own_read_ || index >= own_read_->size()) {
    auto flight = capture::Flight::open(own_);
    if (!flight) return tl::unexpected(flight.error());
    own_read_.emplace(std::move(*flight));
  }
  if (index >= own_read_->size())
    return fail(ErrorCode::NotFound, fmt::format("frame {} is not recorded", id));
  return own_read_->load(index);
}

void RecordedFrames::close() {
  const std::scoped_lock lock(mutex_);
  if (recorder_) (void)recorder_->close();
}

}  // namespace overfly::daemon
