#pragma once
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "capture/record/flight.h"
#include "capture/record/recorder.h"
#include "config/error.h"

namespace overfly::daemon {

// The frames of a mission on disk: written as they come, read again when a stage needs one that has left
// memory, and all of them after a restart. A mission that is taken up again gets one more flight folder
// beside the earlier ones (flight-1, flight-2, ...). Ids count through all of them. Thread-safe.
class RecordedFrames {
 public:
  // `folder`: the mission's. Reads what earlier runs left.
  [[nodiscard]] static Result<std::unique_ptr<RecordedFrames>> open(const std::filesystem::path& folder);

  // Frames of earlier runs.
  [[nodiscard]] std::uint64_t earlier() const { return first_id_; }
  // What the first run knew of the flight.
  [[nodiscard]] std::optional<capture::FlightInfo> earlierInfo() const {
    return parts_.empty() ? std::nullopt : std::optional(parts_.front().info());
  }
  // An earlier run has recorded a frame of this name.
  [[nodiscard]] bool hasEarlier(const std::string& name) const { return earlier_names_.contains(name); }
  // Writes a frame; returns its id. The first call makes this run's folder.
  [[nodiscard]] Result<std::uint64_t> record(const capture::Frame& frame, const capture::FlightInfo& info,
                                             const capture::TelemetryPtr& raw = nullptr);
  // As recorded, or as corrected since.
  [[nodiscard]] Result<capture::FramePtr> load(std::uint64_t id);
  // What an earlier run recorded of a frame beside its picture; null: not of an earlier run.
  [[nodiscard]] const capture::FlightFrame* entryOf(std::uint64_t id) const;
  // From now on the frame has this pose and lens. The recording itself keeps what the device said.
  void correct(std::uint64_t id, const capture::Pose& pose, const capture::CameraModel& camera,
               bool adjusted);
  // The pose of a frame of this run that was recorded without one; returns the frame's id.
  [[nodiscard]] Result<std::uint64_t> record(const capture::LatePose& late);
  // A raw input; those before the first frame are dropped, as there is no recording yet.
  void record(const capture::RawInput& input);
  // Where the image of a frame lies, for what keeps the disk's budget.
  [[nodiscard]] std::optional<std::filesystem::path> imageOf(std::uint64_t id) const;
  void close();

 private:
  struct Correction {
    capture::Pose pose;
    capture::CameraModel camera;
    bool adjusted = false;
  };

  explicit RecordedFrames(std::filesystem::path folder) : folder_(std::move(folder)) {}
  [[nodiscard]] Result<capture::FramePtr> loadRecorded(std::uint64_t id);

  mutable std::mutex mutex_;
  std::filesystem::path folder_;
  std::set<std::string> earlier_names_;
  std::vector<capture::Flight> parts_;  // of earlier runs
  std::uint64_t first_id_ = 0;          // of this run
  std::filesystem::path own_;
  std::optional<capture::FlightRecorder> recorder_;
  std::uint64_t recorded_ = 0;
  std::map<std::pair<std::string, std::uint64_t>, std::uint64_t> unposed_;  // camera and number to id
  std::vector<std::string> own_names_;
  std::optional<capture::Flight> own_read_;  // as far as it was read back
  std::map<std::uint64_t, Correction> corrections_;
};

}  // namespace overfly::daemon
