#include "capture/live/live_source.h"

#include <time.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "capture/geo/geodetic.h"

namespace overfly::capture {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
constexpr std::int64_t kPulseWait_ns = 100'000'000;  // an edge is told long before, when there is one
constexpr std::size_t kMostPending = 64;
constexpr std::size_t kMostAwaiting = 4096;
constexpr std::chrono::milliseconds kGlance{10};

std::int64_t clockNow(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return std::int64_t{t.tv_sec} * kSecond + t.tv_nsec;
}

std::int64_t nowNs() { return clockNow(CLOCK_BOOTTIME); }

}  // namespace

LiveSource::LiveSource(Parts parts, LiveOptions options)
    : options_(options),
      camera_(std::move(parts.camera)),
      matcher_(options.matcher),
      trigger_(std::move(parts.trigger)) {
  const auto raw = [this](const RawInput& input) {
    const std::scoped_lock lock(raw_mutex_);
    if (on_raw_) on_raw_(input);
  };
  if (parts.autopilot) {
    Autopilot::Listeners listeners;
    listeners.raw = raw;
    listeners.armed = [this](bool armed) {
      const std::scoped_lock lock(mutex_);
      armed_ = armed;
      if (on_armed_) on_armed_(armed);
    };
    listeners.pulse = [this](const ReportedPulse& pulse) {
      if (options_.pulses == (pulse.feedback ? PulsesFrom::Feedback : PulsesFrom::Trigger))
        addPulse(pulse.time_ns, pulse.sigma_ns);
    };
    autopilot_ = parts.autopilot(std::move(listeners));
  }
  if (parts.gpio) {
    GpioStamps::Listeners listeners;
    listeners.raw = raw;
    listeners.exposure = [this](std::int64_t edge_ns) {
      if (options_.pulses == PulsesFrom::Gpio) addPulse(edge_ns, 1000);
    };
    listeners.pps = [this](std::int64_t edge_ns) { addPps(edge_ns); };
    listeners.quiet = [this](std::int64_t until_ns) {
      const std::scoped_lock lock(mutex_);
      quiet_ns_ = std::max(quiet_ns_, until_ns);
    };
    gpio_ = parts.gpio(std::move(listeners));
  }
  // The vehicle and the lines are listened to before the camera is there and while it is away.
  if (autopilot_) autopilot_->start();
  if (gpio_) gpio_->start();
}

LiveSource::~LiveSource() {
  trigger_.reset();
  gpio_.reset();
  autopilot_.reset();
}

std::string LiveSource::describe() const { return camera_->describe(); }

Result<void> LiveSource::open() {
  {
    const std::scoped_lock lock(mutex_);
    stopped_ = false;
  }
  pending_.clear();
  if (auto opened = camera_->open(); !opened) return opened;
  if (trigger_) trigger_->start();
  return {};
}

void LiveSource::stop() {
  {
    const std::scoped_lock lock(mutex_);
    stopped_ = true;
  }
  camera_->stop();
}

void LiveSource::close() {
  if (trigger_) trigger_->stop();
  camera_->close();
  pending_.clear();
}

Result<FramePtr> LiveSource::next(std::chrono::milliseconds timeout) {
  using Clock = std::chrono::steady_clock;
  const auto deadline = Clock::now() + timeout;
  for (;;) {
    {
      const std::scoped_lock lock(mutex_);
      if (stopped_) return FramePtr();
    }
    collectLate();
    if (!pending_.empty() && settleFront(nowNs(), pending_.size() > kMostPending)) return takeFront();
    const auto left = std::max(std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now()),
                               std::chrono::milliseconds(0));
    auto frame = camera_->next(pending_.empty() ? left : std::min(left, kGlance));
    if (frame && *frame) {
      pending_.push_back({std::make_shared<Frame>(**frame), nowNs(), false});
      continue;
    }
    if (frame) {  // the camera has ended or was stopped
      const std::scoped_lock lock(mutex_);
      if (stopped_ || pending_.empty()) return FramePtr();
    } else if (frame.error().code != ErrorCode::Unavailable) {
      return frame;
    }
    if (Clock::now() >= deadline) {
      if (!frame) return frame;
      return fail(ErrorCode::Unavailable, "the last frames wait for their poses");
    }
    // A camera that has ended or is away says so at once, and the frames before it still wait for their
    // poses.
    if (frame || !pending_.empty()) {
      timespec pause{0, 2'000'000};
      nanosleep(&pause, nullptr);
    }
  }
}

bool LiveSource::settleFront(std::int64_t now_ns, bool hurry) {
  Pending& front = pending_.front();
  Frame& frame = *front.frame;
  if (!front.stamped) {
    const bool wait =
        options_.pulses != PulsesFrom::None && !hurry && now_ns - front.arrived_ns < kPulseWait_ns;
    {
      const std::scoped_lock lock(mutex_);
      const auto lag = matcher_.lag();
      const std::int64_t due = frame.time_ns - (lag ? lag->ns : 0);
      if (wait && std::max(matcher_.newestPulse(), quiet_ns_) < due) return false;
    }
    stamp(front);
  }
  if (!autopilot_) {
    frame.no_pose_reason = "no autopilot";
    return true;
  }
  auto pose = poseAt(frame.time_ns, frame.time_sigma_ns);
  if (pose) {
    frame.pose = *pose;
    frame.datum = autopilot_->datum();
    return true;
  }
  const auto oldest = autopilot_->poses().oldest();
  if (pose.error().code == ErrorCode::NotFound && oldest) {
    const bool before = frame.time_ns + options_.mount.delay_ns < *oldest;
    frame.no_pose_reason = before ? "before the first pose" : "a gap in the poses";
    return true;
  }
  if (!hurry && now_ns - front.arrived_ns < options_.max_wait_ns) return false;
  frame.no_pose_reason = reasonNow();
  awaiting_.push_back({frame.camera_id, frame.sequence, frame.time_ns, frame.time_sigma_ns});
  if (awaiting_.size() > kMostAwaiting) awaiting_.pop_front();
  return true;
}

const char* LiveSource::reasonNow() const {
  const AutopilotStatus status = autopilot_->status();
  switch (status.state) {
    case AutopilotState::NoLink:
      return "no link to the autopilot";
    case AutopilotState::Silent:
      return "the autopilot is silent";
    case AutopilotState::Talking:
      break;
  }
  return status.telemetry.position.empty() ? "no position" : "poses come late";
}

void LiveSource::stamp(Pending& pending) {
  Frame& frame = *pending.frame;
  pending.stamped = true;
  const std::scoped_lock lock(mutex_);
  if (options_.pulses != PulsesFrom::None) {
    const std::int64_t to_middle = frame.exposure_ns / 2 + options_.rolling_shutter_ns / 2;
    const auto match = matcher_.match(frame.time_ns);
    if (match) {
      frame.time_ns = match->pulse_ns + to_middle;
      frame.time_sigma_ns = match->sigma_ns;
    } else if (const auto lag = matcher_.lag()) {
      frame.time_ns += to_middle - lag->ns;
      frame.time_sigma_ns = std::max(lag->sigma_ns, frame.time_sigma_ns);
    }
  }
  // Times increase, whatever stamped them.
  auto [last, first] = last_time_ns_.try_emplace(frame.camera_id, frame.time_ns);
  if (!first) {
    frame.time_ns = std::max(frame.time_ns, last->second + 1);
    last->second = frame.time_ns;
  }
  if (const auto utc = utcOffset(frame.time_ns)) {
    frame.utc_offset_ns = utc->ns;
    status_.utc_offset_ns = utc->ns;
    status_.utc_sigma_ns = utc->sigma_ns;
  }
}

// By the receiver's PPS, else by the autopilot, else by this machine's own clock where it was ever set.
std::optional<ClockRecovery::Time> LiveSource::utcOffset(std::int64_t time_ns) const {
  if (const auto utc = utc_by_pps_.deviceFrom(time_ns)) {
    const auto back = utc_by_pps_.boottimeFrom(*utc);
    return ClockRecovery::Time{*utc - time_ns, back ? back->sigma_ns : 0};
  }
  if (autopilot_)
    if (const auto utc = autopilot_->utcOffset(time_ns)) return utc;
  constexpr std::int64_t k2020_ns = 1'577'836'800 * kSecond;
  const std::int64_t own = clockNow(CLOCK_REALTIME);
  if (own < k2020_ns) return std::nullopt;
  return ClockRecovery::Time{own - nowNs(), kSecond};
}

Result<Pose> LiveSource::poseAt(std::int64_t time_ns, std::int64_t sigma_ns) const {
  const PoseTrack& track = autopilot_->poses();
  auto pose = track.at(time_ns, options_.mount);
  if (!pose || sigma_ns <= 0) return pose;
  // What the time's uncertainty is at the speed and the turning of that moment.
  constexpr std::int64_t kStep_ns = 20'000'000;
  const auto before = track.at(time_ns - kStep_ns, options_.mount);
  const auto after = track.at(time_ns + kStep_ns, options_.mount);
  const Pose& a = before ? *before : *pose;
  const Pose& b = after ? *after : *pose;
  if (b.time_ns == a.time_ns) return pose;
  const double share = static_cast<double>(sigma_ns) / static_cast<double>(b.time_ns - a.time_ns);
  const Eigen::Matrix3d enu_from_ecef =
      geo::LocalFrame(geo::geodeticFromEcef(pose->position_in_ecef)).enuFromEcefRotation();
  const Eigen::AngleAxisd turn(b.ecef_from_camera * a.ecef_from_camera.conjugate());
  Eigen::Matrix<double, 6, 1> smear;
  smear << enu_from_ecef * (b.position_in_ecef - a.position_in_ecef),
      enu_from_ecef * (turn.angle() * turn.axis());
  smear *= share;
  pose->covariance += smear * smear.transpose();
  return pose;
}

FramePtr LiveSource::takeFront() {
  std::shared_ptr<Frame> frame = std::move(pending_.front().frame);
  pending_.pop_front();
  {
    const std::scoped_lock lock(mutex_);
    if (frame->pose) {
      ++status_.with_pose;
    } else {
      ++status_.without_pose[frame->no_pose_reason];
    }
  }
  if (autopilot_) {
    if (frame->camera.width != told_.width || frame->camera.height != told_.height) {
      const CameraStatus camera = camera_->status();
      if (!camera.vendor.empty()) told_.vendor = camera.vendor;
      if (!camera.model.empty()) told_.model = camera.model;
      told_.width = frame->camera.width;
      told_.height = frame->camera.height;
      told_.capturing = true;
      autopilot_->setCamera(told_);
    }
    autopilot_->imageCaptured(*frame);
  }
  return frame;
}

void LiveSource::collectLate() {
  while (!awaiting_.empty()) {
    const Awaiting& first = awaiting_.front();
    auto pose = poseAt(first.time_ns, first.time_sigma_ns);
    if (!pose && (pose.error().code == ErrorCode::Unavailable || !autopilot_->poses().oldest())) return;
    if (pose) {
      late_.push_back({first.camera_id, first.sequence, *pose, autopilot_->datum()});
      const std::scoped_lock lock(mutex_);
      ++status_.late_poses;
    }
    awaiting_.pop_front();
  }
}

std::vector<LatePose> LiveSource::takeLatePoses() { return std::exchange(late_, {}); }

void LiveSource::addPulse(std::int64_t time_ns, std::int64_t sigma_ns) {
  const std::scoped_lock lock(mutex_);
  matcher_.addPulse(time_ns, sigma_ns);
}

// The edge is a whole second of UTC: which one, the autopilot or this machine's clock knows well enough.
void LiveSource::addPps(std::int64_t edge_ns) {
  std::optional<std::int64_t> offset;
  if (autopilot_)
    if (const auto utc = autopilot_->utcOffset(edge_ns)) offset = utc->ns;
  if (!offset) return;
  const std::int64_t utc = edge_ns + *offset;
  const std::int64_t second = (utc + kSecond / 2) / kSecond * kSecond;
  if (std::abs(utc - second) > kSecond * 2 / 5) return;
  const ClockPair pair{nowNs(), DeviceClock::UtcByPps, second, edge_ns, 1000};
  {
    const std::scoped_lock lock(mutex_);
    utc_by_pps_.addPair(pair.device_ns, pair.boottime_ns, pair.uncertainty_ns);
  }
  const std::scoped_lock lock(raw_mutex_);
  if (on_raw_) on_raw_(pair);
}

LiveStatus LiveSource::status() const {
  LiveStatus status;
  {
    const std::scoped_lock lock(mutex_);
    status = status_;
    status.pulses = matcher_.counts();
    status.lag = matcher_.lag();
  }
  status.camera = camera_->status();
  if (autopilot_) status.autopilot = autopilot_->status();
  if (gpio_) status.gpio = gpio_->status();
  if (trigger_) status.trigger = trigger_->status();
  return status;
}

void LiveSource::onRaw(std::function<void(const RawInput&)> listener) {
  const std::scoped_lock lock(raw_mutex_);
  on_raw_ = std::move(listener);
}

void LiveSource::onArmed(std::function<void(bool)> listener) {
  const std::scoped_lock lock(mutex_);
  on_armed_ = std::move(listener);
  if (on_armed_ && armed_) on_armed_(*armed_);
}

void LiveSource::say(std::uint8_t severity, const std::string& text) {
  if (autopilot_) autopilot_->say(severity, text);
}

}  // namespace overfly::capture
