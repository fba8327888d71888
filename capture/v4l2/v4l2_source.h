#pragma once
#include <memory>

#include "capture/camera_source.h"
#include "capture/live_camera_options.h"
#include "capture/v4l2/kernel.h"

namespace overfly::capture {

// A camera of Video4Linux (USB cameras, frame grabbers, boards whose driver gives ready pictures). Pictures
// are streamed into buffers that the driver shares with this process, and each is copied once into its frame,
// so that a slow consumer holds back frames of its own but never the camera's buffers.
//
// Frame::time_ns: the driver's monotonic stamp, moved to CLOCK_BOOTTIME by the difference of the two clocks
// at that moment (they part only while the machine sleeps); from the exposure's start, or from the frame's
// end, by half the exposure and half the roll of the shutter. A driver without such stamps gives the time at
// which the frame was taken over, with a larger sigma.
//
// Errors of open(): Unavailable (absent, in use, no signal), Io (not permitted: the message names the group),
// Unsupported (no camera, not this format, or a lens for another shape of picture). All may be tried again.
// Damaged pictures are BadInput and are counted.
class V4l2Source final : public CameraSource {
 public:
  explicit V4l2Source(LiveCameraOptions options, std::shared_ptr<v4l2::Kernel> kernel = v4l2::systemKernel());
  ~V4l2Source() override;

  [[nodiscard]] Result<void> open() override;
  [[nodiscard]] Result<FramePtr> next(std::chrono::milliseconds timeout) override;
  void stop() override;
  void close() override;
  [[nodiscard]] std::string describe() const override;
  [[nodiscard]] CameraStatus status() const override;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace overfly::capture
