#pragma once
#include <chrono>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "capture/frame.h"
#include "config/error.h"

namespace overfly::capture {

// The pose of a frame that was handed out without one.
struct LatePose {
  std::string camera_id;
  std::uint64_t sequence = 0;  // the frame's
  Pose pose;                   // time_ns is the frame's
  VerticalDatum datum = VerticalDatum::Unknown;
};

// Anything that yields frames in time order: a recorded flight, a simulated one, V4L2, libcamera.
// Thread rule: one thread calls open/next/close; stop() may be called from any thread.
// Contract (held by the compliance suite): after open() the first next() yields a frame or an error within
// its timeout; times strictly increase; after stop() a waiting next() returns within 1 s and no frame
// follows; a closed source can be opened again; open() of an absent device is an Unavailable error.
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  FrameSource() = default;
  FrameSource(const FrameSource&) = delete;
  FrameSource& operator=(const FrameSource&) = delete;

  [[nodiscard]] virtual Result<void> open() = 0;

  // The next frame; a null pointer when the source has ended or was stopped. Waits at most `timeout`
  // for it: then Unavailable. BadInput: this frame was unusable, the next may be good.
  [[nodiscard]] virtual Result<FramePtr> next(std::chrono::milliseconds timeout) = 0;

  // Poses that have come since the last call for frames that next() handed out without; each once. By the
  // thread that calls next(). A source that knows its poses at once has none.
  [[nodiscard]] virtual std::vector<LatePose> takeLatePoses() { return {}; }

  virtual void stop() = 0;
  virtual void close() = 0;

  // "replay:/path", "scene:village", "v4l2:/dev/video0": for logs and status.
  [[nodiscard]] virtual std::string describe() const = 0;
};

}  // namespace overfly::capture
