#pragma once
#include <chrono>
#include <filesystem>
#include <memory>

#include "capture/frame.h"
#include "capture/frame_source.h"
#include "capture/record/flight.h"
#include "capture/record/raw_log.h"
#include "config/error.h"

namespace overfly::capture {

struct RecorderOptions {
  // What is younger than this and the time that the disk takes may be lost by a power cut (never by a kill);
  // 0: every frame reaches the disk before record() returns. Raising it spares a slow card.
  std::chrono::nanoseconds sync_interval = std::chrono::seconds(1);
};

// Writes a flight (docs/flight-format.md). A kill at any moment leaves a readable flight: at most the frame
// or raw input that was being written is missing. Thread-safe: one thread may record frames while others
// record raw inputs; frames do not delay raw inputs. A thread of its own waits for the disk: an error that it
// meets is the next call's.
class FlightRecorder {
 public:
  // Makes the folder (its parent must exist or be creatable). BadInput: it already holds something; Io.
  // An empty info.boot_id is filled with this boot's.
  [[nodiscard]] static Result<FlightRecorder> create(const std::filesystem::path& folder, FlightInfo info,
                                                     const RecorderOptions& options = {});
  FlightRecorder(FlightRecorder&&) noexcept;
  FlightRecorder& operator=(FlightRecorder&&) noexcept;
  ~FlightRecorder();  // closes

  // BadInput: the frame's image or camera cannot be kept (empty, wrong stride, wrong model); Io.
  [[nodiscard]] Result<void> record(const Frame& frame, const TelemetryPtr& raw = nullptr);
  [[nodiscard]] Result<void> record(const RawInput& input);
  // The pose of a frame that was recorded without one (of the last 4,096 such frames): a further line for the
  // same image. NotFound: no such frame waits for a pose; Io.
  [[nodiscard]] Result<void> record(const LatePose& late);

  // Brings everything to the disk now.
  [[nodiscard]] Result<void> sync();
  // sync(), and no more recording: later calls are Unavailable errors.
  [[nodiscard]] Result<void> close();

  [[nodiscard]] std::uint64_t framesRecorded() const;

 private:
  class Files;
  explicit FlightRecorder(std::unique_ptr<Files> files);
  std::unique_ptr<Files> files_;
};

}  // namespace overfly::capture
