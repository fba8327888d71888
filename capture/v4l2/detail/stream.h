#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "capture/v4l2/detail/controls.h"
#include "capture/v4l2/detail/mode.h"
#include "capture/v4l2/detail/node.h"

namespace overfly::capture::v4l2 {

// One filled buffer, still the driver's memory: valid until giveBack().
struct Taken {
  std::uint32_t index = 0;
  std::span<const std::uint8_t> bytes;
  std::uint32_t sequence = 0;  // the driver's
  std::int64_t stamp_ns = 0;   // CLOCK_MONOTONIC; 0: the driver gives none
  bool at_start = false;       // the stamp is the exposure's start, otherwise the frame's end
  bool damaged = false;
};

// A camera that streams into buffers mapped here (V4L2_MEMORY_MMAP). Move-only; stops and unmaps.
// Thread-bound.
class Stream {
 public:
  [[nodiscard]] static Result<Stream> start(Node node, const LiveCameraOptions& options);
  Stream(Stream&&) noexcept = default;
  Stream& operator=(Stream&&) = delete;
  ~Stream();

  // The oldest filled buffer; nullopt when there is none yet. Unavailable or Io: the camera is gone.
  [[nodiscard]] Result<std::optional<Taken>> take();
  [[nodiscard]] Result<void> giveBack(std::uint32_t index);

  [[nodiscard]] int fd() const { return node_.fd(); }
  [[nodiscard]] const Node& node() const { return node_; }
  [[nodiscard]] const Mode& mode() const { return mode_; }
  [[nodiscard]] const Controls& controls() const { return controls_; }

 private:
  struct Mapping {
    void* address = nullptr;
    std::size_t length = 0;
  };
  Stream(Node node, Mode mode, Controls controls)
      : node_(std::move(node)), mode_(mode), controls_(std::move(controls)) {}
  [[nodiscard]] Result<void> makeBuffers(int wanted);

  Node node_;
  Mode mode_;
  Controls controls_;
  std::vector<Mapping> mappings_;
  bool streaming_ = false;
};

}  // namespace overfly::capture::v4l2
