#include "capture/v4l2/v4l2_source.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <ctime>
#include <mutex>
#include <optional>
#include <utility>

#include "capture/frame_numbers.h"
#include "capture/v4l2/detail/stream.h"

namespace overfly::capture {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;
using v4l2::Node;
using v4l2::Stream;
using v4l2::Taken;

constexpr milliseconds kReplugInterval{200};
// An interrupt is served, and the frame stamped, within this on a machine that is not real-time.
constexpr std::int64_t kStampSigmaNs = 100'000;
// A frame that was stamped here has waited for this process.
constexpr std::int64_t kOwnStampSigmaNs = 5'000'000;

std::int64_t nowOf(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

// Wakes a poll() from another thread.
class Bell {
 public:
  Bell() : fd_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {}
  ~Bell() { ::close(fd_); }
  Bell(const Bell&) = delete;
  Bell& operator=(const Bell&) = delete;
  void ring() const { (void)eventfd_write(fd_, 1); }
  void silence() const {
    eventfd_t count = 0;
    (void)eventfd_read(fd_, &count);
  }
  [[nodiscard]] int fd() const { return fd_; }

 private:
  int fd_;
};

}  // namespace

struct V4l2Source::State {
  LiveCameraOptions options;
  std::shared_ptr<v4l2::Kernel> kernel;
  Bell bell;
  std::atomic<bool> stopped{false};

  mutable std::mutex mutex;  // guards status
  CameraStatus status;

  // Of the thread that calls open, next and close.
  bool is_open = false;
  std::optional<Stream> stream;  // absent while the camera is away
  CameraModel lens;
  FrameNumbers numbers;
  std::int64_t last_time_ns = 0;
  Clock::time_point next_try;

  void count(const std::string& kind) {
    const std::scoped_lock lock(mutex);
    ++status.errors[kind];
  }

  Result<void> connect() {
    auto node = options.device.empty() ? Node::openFirst(kernel) : Node::open(kernel, options.device);
    if (!node) return tl::unexpected(node.error());
    auto started = Stream::start(std::move(*node), options);
    if (!started) return tl::unexpected(started.error());
    auto model = lensFor(options.lens, started->mode().width, started->mode().height);
    if (!model) return tl::unexpected(model.error());
    lens = std::move(*model);
    stream.emplace(std::move(*started));
    numbers.restart();
    const std::scoped_lock lock(mutex);
    status.present = true;
    status.problem.clear();
    status.vendor = stream->node().driver();
    status.model = stream->node().card();
    status.width = stream->mode().width;
    status.height = stream->mode().height;
    for (const std::string& control : stream->controls().missing) ++status.errors[control];
    return {};
  }

  void setProblem(const Error& error) {
    const std::scoped_lock lock(mutex);
    status.setProblem(error);
  }

  // The camera has gone: it is tried again from now on.
  void lose(const Error& error) {
    stream.reset();
    setProblem(error);
    count("unplugged");
    next_try = Clock::now();
  }

  Result<FramePtr> frameOf(const Taken& taken) {
    const std::int64_t offset_ns = nowOf(CLOCK_BOOTTIME) - nowOf(CLOCK_MONOTONIC);
    const bool stamped = taken.stamp_ns != 0;
    const std::int64_t stamp_ns = (stamped ? taken.stamp_ns : nowOf(CLOCK_MONOTONIC)) + offset_ns;
    const std::int64_t to_middle_ns = (stream->controls().exposure_ns + options.rolling_shutter_ns) / 2;
    auto frame = std::make_shared<Frame>();
    frame->sequence = numbers.take(taken.sequence);
    if (taken.damaged) return fail(ErrorCode::BadInput, "the driver marks the picture as damaged");
    const v4l2::Mode& mode = stream->mode();
    auto image =
        takeImage(taken.bytes, mode.layout, mode.width, mode.height, mode.stride, mode.limited_range);
    if (!image) return tl::unexpected(image.error());
    frame->image = std::move(*image);
    if (frame->image.width != mode.width || frame->image.height != mode.height)
      return fail(ErrorCode::BadInput, fmt::format("the picture is {}x{}, not {}x{}", frame->image.width,
                                                   frame->image.height, mode.width, mode.height));
    frame->name = fmt::format("{:08}.jpg", frame->sequence);
    frame->camera_id = options.camera_id;
    frame->camera = lens;
    frame->time_ns = taken.at_start ? stamp_ns + to_middle_ns : stamp_ns - to_middle_ns;
    frame->time_sigma_ns = stamped ? kStampSigmaNs : kOwnStampSigmaNs;
    frame->utc_offset_ns = nowOf(CLOCK_REALTIME) - nowOf(CLOCK_BOOTTIME);
    frame->exposure_ns = stream->controls().exposure_ns;
    if (frame->time_ns <= last_time_ns)
      return fail(ErrorCode::BadInput, "the driver's time stamps do not increase");
    last_time_ns = frame->time_ns;
    return FramePtr(std::move(frame));
  }

  // Waits for the camera, or for stop(), until then; false when the camera says that nothing will come.
  [[nodiscard]] bool wait(Clock::time_point until) const {
    pollfd fds[2] = {{bell.fd(), POLLIN, 0}, {-1, POLLIN, 0}};
    if (stream) fds[1].fd = stream->fd();
    const auto left = std::chrono::ceil<milliseconds>(until - Clock::now());
    kernel->poll(fds, stream ? 2 : 1, static_cast<int>(std::clamp<std::int64_t>(left.count(), 0, 60'000)));
    return (fds[1].revents & (POLLERR | POLLHUP | POLLNVAL)) == 0;
  }

  // The next filled buffer as a frame; nullopt when there is none now.
  std::optional<Result<FramePtr>> tryTake() {
    auto taken = stream->take();
    if (!taken) {
      lose(taken.error());
      return std::nullopt;
    }
    if (!*taken) return std::nullopt;
    auto frame = frameOf(**taken);
    if (auto ok = stream->giveBack((*taken)->index); !ok) lose(ok.error());
    const std::scoped_lock lock(mutex);
    status.dropped = numbers.dropped();
    if (frame) {
      ++status.frames;
    } else {
      ++status.errors["damaged"];
    }
    return frame;
  }
};

V4l2Source::V4l2Source(LiveCameraOptions options, std::shared_ptr<v4l2::Kernel> kernel)
    : state_(std::make_unique<State>()) {
  state_->options = std::move(options);
  state_->kernel = std::move(kernel);
}

V4l2Source::~V4l2Source() = default;

Result<void> V4l2Source::open() {
  State& s = *state_;
  if (s.is_open) return fail(ErrorCode::Internal, "the camera is open already");
  s.bell.silence();
  s.stopped = false;
  if (auto ok = s.connect(); !ok) {
    s.setProblem(ok.error());
    return ok;
  }
  s.is_open = true;
  return {};
}

Result<FramePtr> V4l2Source::next(milliseconds timeout) {
  State& s = *state_;
  if (!s.is_open) return fail(ErrorCode::Internal, "the camera is not open");
  const Clock::time_point deadline = Clock::now() + timeout;
  for (bool well = true;;) {
    if (s.stopped) return FramePtr();
    if (!s.stream && Clock::now() >= s.next_try) {
      if (auto ok = s.connect(); !ok) {
        s.setProblem(ok.error());
        s.next_try = Clock::now() + kReplugInterval;
      } else {
        const std::scoped_lock lock(s.mutex);
        ++s.status.reconnects;
      }
    }
    if (s.stream) {
      if (auto frame = s.tryTake()) return std::move(*frame);
      if (s.stream && !well) s.lose(s.stream->node().failed("go on streaming", EIO).value());
    }
    if (Clock::now() >= deadline) {
      const std::scoped_lock lock(s.mutex);
      return fail(ErrorCode::Unavailable,
                  s.status.problem.empty() ? "no picture has come yet" : s.status.problem);
    }
    well = s.wait(s.stream ? deadline : std::min(deadline, s.next_try));
  }
}

void V4l2Source::stop() {
  state_->stopped = true;
  state_->bell.ring();
}

void V4l2Source::close() {
  State& s = *state_;
  s.stream.reset();
  s.is_open = false;
  const std::scoped_lock lock(s.mutex);
  s.status.present = false;
}

std::string V4l2Source::describe() const {
  return "v4l2:" + (state_->options.device.empty() ? std::string("first") : state_->options.device);
}

CameraStatus V4l2Source::status() const {
  const std::scoped_lock lock(state_->mutex);
  return state_->status;
}

}  // namespace overfly::capture
