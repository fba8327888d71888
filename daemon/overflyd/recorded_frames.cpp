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
    for (const capture::FlightFrame& entry : flight->frames())
      frames->earlier_names_.insert(entry.frame.name);
    frames->parts_.push_back(std::move(*flight));
  }
  return frames;
}

Result<std::uint64_t> RecordedFrames::record(const capture::Frame& frame, const capture::FlightInfo& info,
                                             const capture::TelemetryPtr& raw) {
  const std::scoped_lock lock(mutex_);
  if (!recorder_) {
    auto created = capture::FlightRecorder::create(own_, info);
    if (!created) return tl::unexpected(created.error());
    recorder_.emplace(std::move(*created));
  }
  if (auto ok = recorder_->record(frame, raw); !ok) return tl::unexpected(ok.error());
  own_names_.push_back(frame.name);
  const std::uint64_t id = first_id_ + recorded_++;
  if (!frame.pose) unposed_[{frame.camera_id, frame.sequence}] = id;
  return id;
}

Result<std::uint64_t> RecordedFrames::record(const capture::LatePose& late) {
  const std::scoped_lock lock(mutex_);
  const auto found = unposed_.find({late.camera_id, late.sequence});
  if (!recorder_ || found == unposed_.end())
    return fail(ErrorCode::NotFound, fmt::format("frame {} does not wait for a pose", late.sequence));
  if (auto ok = recorder_->record(late); !ok) return tl::unexpected(ok.error());
  const std::uint64_t id = found->second;
  unposed_.erase(found);
  own_read_.reset();  // what was read of this run does not have the pose
  return id;
}

void RecordedFrames::record(const capture::RawInput& input) {
  // Only for the pointer: the recorder has locks of its own, and frames must not hold up telemetry.
  capture::FlightRecorder* recorder = nullptr;
  {
    const std::scoped_lock lock(mutex_);
    if (recorder_) recorder = &*recorder_;
  }
  if (recorder != nullptr) (void)recorder->record(input);
}

const capture::FlightFrame* RecordedFrames::entryOf(std::uint64_t id) const {
  if (id >= first_id_) return nullptr;
  for (const capture::Flight& part : parts_) {
    if (id < part.size()) return &part.at(id);
    id -= part.size();
  }
  return nullptr;
}

void RecordedFrames::correct(std::uint64_t id, const capture::Pose& pose, const capture::CameraModel& camera,
                             bool adjusted) {
  const std::scoped_lock lock(mutex_);
  corrections_.insert_or_assign(id, Correction{pose, camera, adjusted});
}

Result<capture::FramePtr> RecordedFrames::load(std::uint64_t id) {
  const std::scoped_lock lock(mutex_);
  auto loaded = loadRecorded(id);
  const auto correction = corrections_.find(id);
  if (!loaded || correction == corrections_.end()) return loaded;
  auto frame = std::make_shared<capture::Frame>(**loaded);
  frame->pose = correction->second.pose;
  frame->camera = correction->second.camera;
  frame->pose_is_adjusted = correction->second.adjusted;
  return frame;
}

Result<capture::FramePtr> RecordedFrames::loadRecorded(std::uint64_t id) {
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

std::optional<std::filesystem::path> RecordedFrames::imageOf(std::uint64_t id) const {
  const std::scoped_lock lock(mutex_);
  std::optional<std::filesystem::path> path;
  if (id < first_id_) {
    std::uint64_t index = id;
    for (const capture::Flight& part : parts_) {
      if (index < part.size()) {
        path = part.at(index).file;
        break;
      }
      index -= part.size();
    }
  } else if (id - first_id_ < own_names_.size()) {
    path = own_ / "images" / own_names_[id - first_id_];
  }
  std::error_code code;
  if (path && !std::filesystem::is_regular_file(*path, code)) path.reset();
  return path;
}

void RecordedFrames::close() {
  const std::scoped_lock lock(mutex_);
  if (recorder_) (void)recorder_->close();
}

}  // namespace overfly::daemon
