#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "capture/pose/mavlink/codec.h"
#include "capture/pose/mavlink/messages.h"

namespace overfly::capture {

// What we send.
using OutgoingMessage =
    std::variant<mavlink::Heartbeat, mavlink::Timesync, mavlink::CommandLong, mavlink::CommandAck,
                 mavlink::Statustext, mavlink::CameraInformation, mavlink::CameraSettings,
                 mavlink::StorageInformation, mavlink::CameraCaptureStatus, mavlink::CameraImageCaptured>;

// What the ground may ask of a camera.
struct CameraFacts {
  std::string vendor = "overfly", model = "camera";
  int width = 0, height = 0;                                              // pixels
  double focal_length_mm = 0, sensor_width_mm = 0, sensor_height_mm = 0;  // 0: unknown
  double interval_s = 0;                                                  // between frames; 0: unknown
  bool capturing = false;
  double disk_total_mib = 0, disk_free_mib = 0;  // where frames are recorded; 0 and 0: nothing known
};

// The answering side of MAVLink's camera protocol (mavlink.io/en/services/camera.html):
// MAV_CMD_REQUEST_MESSAGE and the older commands that it replaced, one acknowledgement and one message each.
// It takes no picture on command: the flight does. Pure logic; thread-bound.
class CameraComponent {
 public:
  explicit CameraComponent(mavlink::Address self) : self_(self) {}

  void setFacts(CameraFacts facts) { facts_ = std::move(facts); }

  // What to send in answer; nothing when the command is not for us. `boot_ms`: our clock.
  [[nodiscard]] std::vector<OutgoingMessage> answer(const mavlink::CommandLong& command,
                                                    mavlink::Address from, std::uint32_t boot_ms) const;

  // A picture was taken: numbers it, and keeps it for those who ask for it again (the last 256).
  mavlink::CameraImageCaptured captured(mavlink::CameraImageCaptured image);

 private:
  [[nodiscard]] std::optional<OutgoingMessage> message(std::uint32_t id, double which,
                                                       std::uint32_t boot_ms) const;

  mavlink::Address self_;
  CameraFacts facts_;
  std::int32_t count_ = 0;
  std::deque<mavlink::CameraImageCaptured> recent_;
};

}  // namespace overfly::capture
