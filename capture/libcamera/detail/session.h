#pragma once
#include <libcamera/framebuffer_allocator.h>

#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "capture/libcamera/detail/api.h"
#include "capture/libcamera/detail/mapped_buffer.h"
#include "capture/live_camera_options.h"
#include "capture/pixel_layout.h"
#include "config/error.h"

namespace overfly::capture::lc {

// One picture of a camera, still in its buffer: valid until giveBack().
struct Completed {
  libcamera::Request* request = nullptr;
  bool damaged = false;
  std::uint32_t sequence = 0;
  std::optional<std::int64_t> sensor_ns;  // SensorTimestamp: first row's start, CLOCK_BOOTTIME
  std::int64_t buffer_ns = 0;             // when the buffer was filled, by the driver; 0: unknown
  std::int64_t exposure_ns = 0;           // 0: unknown
  double gain = 0;                        // linear; 0: unknown
};

// A camera from its acquisition to its release, streaming. Made and used by one thread; libcamera completes
// requests on a thread of its own and calls `wake` from there.
class Session {
 public:
  [[nodiscard]] static Result<std::unique_ptr<Session>> start(const LiveCameraOptions& options,
                                                              std::function<void()> wake);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  [[nodiscard]] std::optional<Completed> take();
  // The picture's pixels, copied. BadInput: not mapped, or too few bytes.
  [[nodiscard]] Result<Image> imageOf(const Completed& completed) const;
  [[nodiscard]] Result<void> giveBack(libcamera::Request* request);
  // The camera has been taken away.
  [[nodiscard]] bool lost() const;

  [[nodiscard]] const std::string& id() const { return id_; }
  [[nodiscard]] const std::string& model() const { return model_; }
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] const std::vector<std::string>& missing() const { return missing_; }

 private:
  explicit Session(std::function<void()> wake) : wake_(std::move(wake)) {}
  [[nodiscard]] Result<void> choose(const std::string& device);
  [[nodiscard]] Result<void> configure(const LiveCameraOptions& options);
  [[nodiscard]] Result<void> allocate();
  [[nodiscard]] Result<void> begin(const LiveCameraOptions& options);
  [[nodiscard]] libcamera::ControlList controlsFrom(const LiveCameraOptions& options);
  void completed(libcamera::Request* request);
  void disconnected();

  std::function<void()> wake_;
  std::shared_ptr<libcamera::CameraManager> manager_;
  std::shared_ptr<libcamera::Camera> camera_;
  std::unique_ptr<libcamera::CameraConfiguration> configuration_;
  std::unique_ptr<libcamera::FrameBufferAllocator> allocator_;
  std::vector<std::unique_ptr<libcamera::Request>> requests_;
  std::vector<MappedBuffer> buffers_;  // by the request's cookie
  std::string id_, model_;
  PixelLayout layout_;
  int width_ = 0, height_ = 0, stride_ = 0;
  bool limited_range_ = false;
  bool acquired_ = false, running_ = false;
  std::vector<std::string> missing_;

  mutable std::mutex mutex_;  // guards what follows
  std::deque<libcamera::Request*> done_;
  bool lost_ = false;
};

}  // namespace overfly::capture::lc
