#pragma once
#include <memory>
#include <string>
#include <vector>

#include "capture/camera_source.h"
#include "capture/live_camera_options.h"

namespace overfly::capture {

// A camera of libcamera (boards whose sensors need an image pipeline and its control loops: Raspberry Pi,
// i.MX, Rockchip, IPU3, MIPI laptops). One of the buffers is always with the driver as long as the consumer
// takes less than the others last; each picture is copied once into its frame.
//
// LiveCameraOptions::device: libcamera's id (`cam -l` lists them), or the model's name; empty takes the
// first. Frame::time_ns: SensorTimestamp (start of the first row's exposure, CLOCK_BOOTTIME) plus half the
// exposure and half the shutter's roll; exposure_ns and gain are what the sensor did for this frame. A
// pipeline without SensorTimestamp gives the time of the buffer's completion, with a larger sigma.
//
// Errors of open(): Unavailable (absent, in use by another process), Unsupported (not this format or size,
// or a lens for another shape), Io (libcamera refuses). All may be tried again.
class LibcameraSource final : public CameraSource {
 public:
  explicit LibcameraSource(LiveCameraOptions options);
  ~LibcameraSource() override;

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

struct LibcameraCamera {
  std::string id;
  std::string model;
};

// The cameras that libcamera finds now; its version as it says it.
[[nodiscard]] std::vector<LibcameraCamera> libcameraCameras();
[[nodiscard]] std::string libcameraVersion();

}  // namespace overfly::capture
