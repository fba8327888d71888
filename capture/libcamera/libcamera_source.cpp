#include "capture/libcamera/libcamera_source.h"

#include <fmt/format.h>

#include <condition_variable>
#include <ctime>
#include <mutex>
#include <utility>

#include "capture/frame_numbers.h"
#include "capture/libcamera/detail/manager.h"
#include "capture/libcamera/detail/session.h"

namespace overfly::capture {
namespace {

using Clock = std::chrono::steady_clock;
using lc::Completed;
using lc::Session;
using std::chrono::milliseconds;

constexpr milliseconds kReplugInterval{200};
// SensorTimestamp is the start-of-frame interrupt's, or better.
constexpr std::int64_t kSensorSigmaNs = 100'000;
constexpr std::int64_t kBufferSigmaNs = 5'000'000;

std::int64_t nowOf(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

}  // namespace

struct LibcameraSource::State {
  LiveCameraOptions options;

  mutable std::mutex mutex;  // guards what follows, down to the blank line
  std::condition_variable wake;
  CameraStatus status;
  bool stopped = false;
  bool woken = false;  // a request was completed, or the camera has gone

  // Of the thread that calls open, next and close.
  bool is_open = false;
  std::unique_ptr<Session> session;  // absent while the camera is away
  CameraModel lens;
  FrameNumbers numbers;
  std::int64_t last_time_ns = 0;
  Clock::time_point next_try;

  void ring() {
    {
      const std::scoped_lock lock(mutex);
      woken = true;
    }
    wake.notify_all();
  }

  Result<void> connect() {
    auto started = Session::start(options, [this] { ring(); });
    if (!started) return tl::unexpected(started.error());
    auto model = lensFor(options.lens, (*started)->width(), (*started)->height());
    if (!model) return tl::unexpected(model.error());
    lens = std::move(*model);
    session = std::move(*started);
    numbers.restart();
    const std::scoped_lock lock(mutex);
    status.present = true;
    status.problem.clear();
    status.vendor = "libcamera";
    status.model = session->model();
    status.width = session->width();
    status.height = session->height();
    for (const std::string& control : session->missing()) ++status.errors[control];
    return {};
  }

  void setProblem(const Error& error) {
    const std::scoped_lock lock(mutex);
    status.setProblem(error);
  }

  void lose(const std::string& problem) {
    session.reset();
    setProblem({ErrorCode::Unavailable, problem});
    const std::scoped_lock lock(mutex);
    ++status.errors["unplugged"];
    next_try = Clock::now();
  }

  Result<FramePtr> frameOf(const Completed& completed) {
    auto frame = std::make_shared<Frame>();
    frame->sequence = numbers.take(completed.sequence);
    if (completed.damaged) return fail(ErrorCode::BadInput, "the pipeline marks the picture as damaged");
    auto image = session->imageOf(completed);
    if (!image) return tl::unexpected(image.error());
    frame->image = std::move(*image);
    if (frame->image.width != session->width() || frame->image.height != session->height())
      return fail(ErrorCode::BadInput, fmt::format("the picture is {}x{}, not {}x{}", frame->image.width,
                                                   frame->image.height, session->width(), session->height()));
    const std::int64_t to_middle_ns = (completed.exposure_ns + options.rolling_shutter_ns) / 2;
    frame->name = fmt::format("{:08}.jpg", frame->sequence);
    frame->camera_id = options.camera_id;
    frame->camera = lens;
    if (completed.sensor_ns) {
      frame->time_ns = *completed.sensor_ns + to_middle_ns;
      frame->time_sigma_ns = kSensorSigmaNs;
    } else {
      // The buffer's stamp is the driver's, CLOCK_MONOTONIC, at the frame's end.
      const std::int64_t offset_ns = nowOf(CLOCK_BOOTTIME) - nowOf(CLOCK_MONOTONIC);
      const std::int64_t end_ns = completed.buffer_ns != 0 ? completed.buffer_ns : nowOf(CLOCK_MONOTONIC);
      frame->time_ns = end_ns + offset_ns - to_middle_ns;
      frame->time_sigma_ns = kBufferSigmaNs;
    }
    frame->utc_offset_ns = nowOf(CLOCK_REALTIME) - nowOf(CLOCK_BOOTTIME);
    frame->exposure_ns = completed.exposure_ns;
    frame->gain = completed.gain;
    if (frame->time_ns <= last_time_ns)
      return fail(ErrorCode::BadInput, "the camera's time stamps do not increase");
    last_time_ns = frame->time_ns;
    return FramePtr(std::move(frame));
  }

  std::optional<Result<FramePtr>> tryTake() {
    const auto completed = session->take();
    if (!completed) return std::nullopt;
    auto frame = frameOf(*completed);
    if (auto ok = session->giveBack(completed->request); !ok) lose(ok.error().message);
    const std::scoped_lock lock(mutex);
    status.dropped = numbers.dropped();
    if (frame) {
      ++status.frames;
    } else {
      ++status.errors["damaged"];
    }
    return frame;
  }

  void tryAgain() {
    if (auto ok = connect(); !ok) {
      setProblem(ok.error());
      next_try = Clock::now() + kReplugInterval;
      return;
    }
    const std::scoped_lock lock(mutex);
    ++status.reconnects;
  }
};

LibcameraSource::LibcameraSource(LiveCameraOptions options) : state_(std::make_unique<State>()) {
  state_->options = std::move(options);
}

LibcameraSource::~LibcameraSource() { state_->session.reset(); }

Result<void> LibcameraSource::open() {
  State& s = *state_;
  if (s.is_open) return fail(ErrorCode::Internal, "the camera is open already");
  {
    const std::scoped_lock lock(s.mutex);
    s.stopped = false;
  }
  if (auto ok = s.connect(); !ok) {
    s.setProblem(ok.error());
    return ok;
  }
  s.is_open = true;
  return {};
}

Result<FramePtr> LibcameraSource::next(milliseconds timeout) {
  State& s = *state_;
  if (!s.is_open) return fail(ErrorCode::Internal, "the camera is not open");
  const Clock::time_point deadline = Clock::now() + timeout;
  for (;;) {
    {
      const std::scoped_lock lock(s.mutex);
      if (s.stopped) return FramePtr();
      s.woken = false;
    }
    if (s.session && s.session->lost())
      s.lose(fmt::format("camera {} is unplugged: plug it in again", s.session->id()));
    if (!s.session && Clock::now() >= s.next_try) s.tryAgain();
    if (s.session) {
      if (auto frame = s.tryTake()) return std::move(*frame);
    }
    const Clock::time_point until = s.session ? deadline : std::min(deadline, s.next_try);
    std::unique_lock lock(s.mutex);
    if (Clock::now() >= deadline)
      return fail(ErrorCode::Unavailable,
                  s.status.problem.empty() ? "no picture has come yet" : s.status.problem);
    s.wake.wait_until(lock, until, [&] { return s.stopped || s.woken; });
  }
}

void LibcameraSource::stop() {
  {
    const std::scoped_lock lock(state_->mutex);
    state_->stopped = true;
  }
  state_->wake.notify_all();
}

void LibcameraSource::close() {
  State& s = *state_;
  s.session.reset();
  s.is_open = false;
  const std::scoped_lock lock(s.mutex);
  s.status.present = false;
}

std::string LibcameraSource::describe() const {
  return "libcamera:" + (state_->options.device.empty() ? std::string("first") : state_->options.device);
}

CameraStatus LibcameraSource::status() const {
  const std::scoped_lock lock(state_->mutex);
  return state_->status;
}

std::vector<LibcameraCamera> libcameraCameras() {
  std::vector<LibcameraCamera> out;
  if (const auto manager = lc::sharedManager())
    for (const auto& camera : manager->cameras()) out.push_back({camera->id(), lc::modelOf(*camera)});
  return out;
}

std::string libcameraVersion() { return libcamera::CameraManager::version(); }

}  // namespace overfly::capture
