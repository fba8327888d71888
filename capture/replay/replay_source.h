#pragma once
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <variant>

#include "capture/frame_source.h"
#include "capture/import/import_flight.h"

namespace overfly::capture {

// Faults on demand, for tests: each is the share of frames it happens to, 0..1. Which frames depends on the
// seed and the frame's index alone, not on pace or on other faults.
struct ReplayFaults {
  std::uint64_t seed = 1;
  double drop = 0;          // the frame never comes (its sequence number is a gap)
  double duplicate = 0;     // comes twice: the same time and number again
  double reorder = 0;       // changes places with the next one
  double corrupt_jpeg = 0;  // bytes of the image are changed or its end is cut off
  double lose_pose = 0;     // comes without a pose
  double stall = 0;         // nothing comes for stall_time before it
  std::chrono::milliseconds stall_time{2000};
};

struct ReplayOptions {
  double speed = 1;       // times true time; 0: as fast as the consumer takes frames
  bool loop = false;      // begin again at the end; times and numbers go on increasing
  std::size_t start = 0;  // first frame of the first round
  ReplayFaults faults;
  ImportOptions import;
};

// The mock camera: a recorded flight (or any folder that the importer understands) as a FrameSource. Frames
// carry their recorded times. A frame whose image does not read is a BadInput error, the next one follows.
// Late consumers lose nothing: what is due is handed over at once.
class ReplaySource final : public FrameSource {
 public:
  explicit ReplaySource(std::filesystem::path folder, ReplayOptions options = {});
  explicit ReplaySource(std::shared_ptr<const Flight> flight, ReplayOptions options = {});
  ~ReplaySource() override;

  [[nodiscard]] Result<void> open() override;
  [[nodiscard]] Result<FramePtr> next(std::chrono::milliseconds timeout) override;
  void stop() override;
  void close() override;
  [[nodiscard]] std::string describe() const override;

  // The flight that plays; null before the first open() of a folder.
  [[nodiscard]] std::shared_ptr<const Flight> flight() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace overfly::capture
