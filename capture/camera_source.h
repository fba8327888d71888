#pragma once
#include <cstdint>
#include <map>
#include <string>

#include "capture/frame_source.h"

namespace overfly::capture {

// What a live camera says of itself. Copied out; counts since the object was made.
struct CameraStatus {
  bool present = false;  // the device is there and streams
  std::string problem;   // one sentence for a person while it is not; empty otherwise
  std::string vendor, model;
  int width = 0, height = 0;  // pixels of a frame; 0 before the first open()
  std::uint64_t frames = 0;   // handed out
  std::uint64_t dropped = 0;  // gaps in the driver's own frame numbers, never in ours
  std::uint64_t reconnects = 0;
  // By kind: "damaged", "unplugged", "no exposure control"; "not there", "refused" and "unsuitable"
  // whenever `problem` says something new.
  std::map<std::string, std::uint64_t> errors;

  // The camera cannot be had now: said, and counted.
  void setProblem(const Error& error);
};

// A live camera before its frames have poses (V4L2, libcamera); capture/live joins it with the autopilot and
// the pulses into a source of frames that can be mapped. It keeps FrameSource's contract, and:
//   - Frame::pose is absent. LiveSource sets it, and may move time_ns when a pulse says it better.
//   - Frame::time_ns is the middle of the exposure of the middle row on CLOCK_BOOTTIME, as well as the
//     driver's own stamp allows; where the driver stamps another event (end of read-out, the frame's
//     arrival), the source takes off what it knows, and the rest is a constant delay for pose.delay_ms.
//     Frame::time_sigma_ns says how much it wanders (1 sigma), not how large the constant is.
//   - Frame::sequence is the driver's frame number, made 64 bits long and never going back: a gap of n is n
//     exposures that happened and were not handed out. It goes on increasing after a re-plug, where the
//     number that was missed is unknown and the gap is at least 1. Pulses are matched with its help.
//   - Frame::exposure_ns and gain where the camera says them.
//   - A device that goes away while the source is open: next() is Unavailable and says so until it is back,
//     and then goes on by itself, without close() and open().
class CameraSource : public FrameSource {
 public:
  // Any thread, at any time.
  [[nodiscard]] virtual CameraStatus status() const = 0;
};

}  // namespace overfly::capture
