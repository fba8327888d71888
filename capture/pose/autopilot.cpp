#include "capture/pose/autopilot.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>

#include "capture/geo/geodetic.h"

namespace overfly::capture {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
constexpr std::size_t kOutbox = 256;
constexpr std::int64_t kAskAgain_ns = 10 * kSecond;  // streams, while poses do not come
constexpr int kQuickTimesyncs = 10;                  // at 10 Hz, then once a second

constexpr std::uint16_t kSetMessageInterval = 511;  // MAV_CMD
constexpr std::uint8_t kTypeCamera = 30, kNoAutopilot = 8, kStateActive = 4, kArmed = 128;

std::int64_t clockNow(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return std::int64_t{t.tv_sec} * kSecond + t.tv_nsec;
}

std::uint32_t bootMs(std::int64_t now_ns) { return static_cast<std::uint32_t>(now_ns / 1'000'000); }

}  // namespace

const char* nameOf(AutopilotState state) {
  switch (state) {
    case AutopilotState::NoLink:
      return "no link";
    case AutopilotState::Silent:
      return "silent";
    case AutopilotState::Talking:
      return "talking";
  }
  return "";
}

Autopilot::Autopilot(std::unique_ptr<Transport> transport, AutopilotOptions options, Listeners listeners)
    : transport_(std::move(transport)),
      options_(std::move(options)),
      listeners_(std::move(listeners)),
      self_{options_.telemetry.autopilot.system, options_.component_id},
      track_(options_.track),
      telemetry_(options_.telemetry, track_),
      camera_(self_) {
  if (options_.key) signer_.emplace(*options_.key, self_.component);
  status_.link = transport_->name();
  status_.problem = "the link is not open yet";
  int ends[2] = {-1, -1};
  if (::pipe2(ends, O_CLOEXEC | O_NONBLOCK) == 0) {
    wake_read_ = FileDescriptor(ends[0]);
    wake_write_ = FileDescriptor(ends[1]);
  }
}

Autopilot::~Autopilot() { stop(); }

void Autopilot::start() {
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

void Autopilot::stop() {
  if (!thread_.joinable()) return;
  thread_.request_stop();
  wake();
  thread_.join();
}

void Autopilot::wake() const {
  const char byte = 0;
  (void)!::write(wake_write_.get(), &byte, 1);
}

void Autopilot::run(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    auto opened = transport_->open();
    if (opened) {
      {
        const std::scoped_lock lock(mutex_);
        status_.state = AutopilotState::Silent;
        status_.problem =
            fmt::format("{}: no heartbeat of system {} yet; is the autopilot on, and does it send here?",
                        transport_->name(), self_.system);
        if (link_lost_) ++status_.events["links opened again"];
      }
      parser_.reset();
      timesyncs_ = 0;
      last_request_ns_ = 0;
      serve(stop);
      transport_->close();
      link_lost_ = true;
    } else {
      const std::scoped_lock lock(mutex_);
      status_.state = AutopilotState::NoLink;
      status_.problem = opened.error().message;
      ++status_.events["link could not be opened"];
    }
    std::mutex pause;
    std::unique_lock lock(pause);
    std::condition_variable_any timer;
    timer.wait_for(lock, stop, options_.retry, [] { return false; });
  }
}

void Autopilot::serve(const std::stop_token& stop) {
  std::vector<std::uint8_t> bytes;
  while (!stop.stop_requested()) {
    bytes.clear();
    auto read = transport_->read(bytes, std::chrono::milliseconds(100), wake_read_.get());
    const std::int64_t now = clockNow(CLOCK_BOOTTIME);
    char drained[64];
    while (::read(wake_read_.get(), drained, sizeof drained) > 0) {
    }
    if (!read) {
      const std::scoped_lock lock(mutex_);
      status_.state = AutopilotState::NoLink;
      status_.problem = read.error().message;
      ++status_.events["links lost"];
      return;
    }
    if (!bytes.empty()) {
      if (listeners_.raw) listeners_.raw(TelemetryPacket{now, 0, bytes});
      parser_.feed(bytes, [&](const mavlink::Packet& packet, std::span<const std::uint8_t> raw) {
        take(packet, raw, now);
      });
    }
    everySecond(now);
    for (;;) {
      std::optional<OutgoingMessage> message;
      {
        const std::scoped_lock lock(mutex_);
        if (outbox_.empty()) break;
        message = std::move(outbox_.front());
        outbox_.pop_front();
      }
      send(*message);
    }
    const std::scoped_lock lock(mutex_);
    status_.packets = parser_.counts();
    if (const std::uint64_t strangers = transport_->strangers(); strangers > 0)
      status_.events["packets from another address than the autopilot's"] = strangers;
  }
}

void Autopilot::take(const mavlink::Packet& packet, std::span<const std::uint8_t> raw,
                     std::int64_t arrival_ns) {
  if (signer_) {
    const auto verdict = signer_->verify(packet, raw);
    if (verdict != mavlink::Signer::Verdict::Good) {
      const std::scoped_lock lock(mutex_);
      ++status_.events[verdict == mavlink::Signer::Verdict::Unsigned   ? "packets without a signature"
                       : verdict == mavlink::Signer::Verdict::WrongKey ? "packets signed with another key"
                                                                       : "packets signed again or too old"];
      if (status_.state != AutopilotState::Talking)
        status_.problem = fmt::format(
            "{}: packets come and their signatures are refused; is pose.signing_key the autopilot's?",
            transport_->name());
      return;
    }
  }
  switch (packet.info->id) {
    case mavlink::Heartbeat::kId:
      return takeHeartbeat(packet, arrival_ns);
    case mavlink::Timesync::kId:
      return takeTimesync(packet, arrival_ns);
    case mavlink::CommandLong::kId: {
      const auto command = mavlink::decode<mavlink::CommandLong>(packet);
      std::vector<OutgoingMessage> answers;
      {
        const std::scoped_lock lock(mutex_);
        answers = camera_.answer(command, packet.from, bootMs(arrival_ns));
        if (!answers.empty()) ++status_.events["commands answered"];
      }
      for (const OutgoingMessage& answer : answers) send(answer);
      return;
    }
    case mavlink::CameraTrigger::kId:
    case mavlink::CameraFeedback::kId: {
      if (!listeners_.pulse || packet.from.system != self_.system) return;
      const bool feedback = packet.info->id == mavlink::CameraFeedback::kId;
      const std::uint64_t usec = feedback ? mavlink::decode<mavlink::CameraFeedback>(packet).time_usec
                                          : mavlink::decode<mavlink::CameraTrigger>(packet).time_usec;
      std::optional<ClockRecovery::Time> time;
      {
        const std::scoped_lock lock(mutex_);
        time = telemetry_.boottimeFromUsec(usec);
      }
      if (time) listeners_.pulse({time->ns, time->sigma_ns, feedback});
      return;
    }
    default: {
      const std::scoped_lock lock(mutex_);
      telemetry_.take(packet, arrival_ns);
    }
  }
}

void Autopilot::takeHeartbeat(const mavlink::Packet& packet, std::int64_t arrival_ns) {
  const auto heartbeat = mavlink::decode<mavlink::Heartbeat>(packet);
  if (packet.from != options_.telemetry.autopilot) {
    if (heartbeat.autopilot == kNoAutopilot) return;  // a ground station, a gimbal, we ourselves
    const std::scoped_lock lock(mutex_);
    ++status_.events[fmt::format("heartbeats of another autopilot, system {}", packet.from.system)];
    if (status_.state != AutopilotState::Talking) {
      status_.problem = fmt::format(
          "{}: an autopilot speaks as system {}, component {}, and system {} is waited for; "
          "set pose.system_id = {} if it is yours",
          transport_->name(), packet.from.system, packet.from.component, self_.system, packet.from.system);
    }
    return;
  }
  last_heartbeat_ns_ = arrival_ns;
  const bool armed = (heartbeat.base_mode & kArmed) != 0;
  bool changed = false;
  {
    const std::scoped_lock lock(mutex_);
    status_.state = AutopilotState::Talking;
    status_.problem.clear();
    changed = !knows_armed_ || status_.armed != armed;
    status_.armed = armed;
  }
  knows_armed_ = true;
  if (changed && listeners_.armed) listeners_.armed(armed);
}

void Autopilot::takeTimesync(const mavlink::Packet& packet, std::int64_t arrival_ns) {
  const auto sync = mavlink::decode<mavlink::Timesync>(packet);
  if (sync.target_system != 0 && sync.target_system != self_.system) return;
  if (sync.target_component != 0 && sync.target_component != self_.component) return;
  if (sync.tc1 == 0) {
    mavlink::Timesync answer;
    answer.tc1 = arrival_ns;
    answer.ts1 = sync.ts1;
    answer.target_system = packet.from.system;
    answer.target_component = packet.from.component;
    return send(answer);
  }
  // Only the answer to our last question: others ask too, with their own clocks.
  if (packet.from != options_.telemetry.autopilot || sync.ts1 != asked_ns_ || asked_ns_ == 0) return;
  const std::int64_t round_trip = arrival_ns - asked_ns_;
  asked_ns_ = 0;
  if (round_trip < 0 || round_trip > kSecond) return;
  const std::int64_t middle = arrival_ns - round_trip / 2;
  // The answer was written anywhere within the round trip; 1 sigma of a uniform distribution.
  const auto sigma = static_cast<std::int64_t>(static_cast<double>(round_trip) / std::sqrt(12.0)) + 1000;
  {
    const std::scoped_lock lock(mutex_);
    telemetry_.addClockPair(sync.tc1, middle, sigma);
  }
  if (listeners_.raw)
    listeners_.raw(ClockPair{arrival_ns, DeviceClock::AutopilotBoot, sync.tc1, middle, sigma});
}

void Autopilot::everySecond(std::int64_t now_ns) {
  const std::int64_t sync_interval = timesyncs_ < kQuickTimesyncs ? kSecond / 10 : kSecond;
  bool talking = false;
  {
    const std::scoped_lock lock(mutex_);
    talking = status_.state == AutopilotState::Talking;
  }
  if (talking && now_ns - last_timesync_ns_ >= sync_interval) {
    last_timesync_ns_ = now_ns;
    ++timesyncs_;
    mavlink::Timesync question;
    asked_ns_ = clockNow(CLOCK_BOOTTIME);
    question.ts1 = asked_ns_;
    question.target_system = options_.telemetry.autopilot.system;
    question.target_component = options_.telemetry.autopilot.component;
    send(question);
  }
  if (now_ns - last_second_ns_ < kSecond) return;
  last_second_ns_ = now_ns;
  mavlink::Heartbeat heartbeat;
  heartbeat.type = kTypeCamera;
  heartbeat.autopilot = kNoAutopilot;
  heartbeat.system_status = kStateActive;
  send(heartbeat);
  std::uint64_t poses = 0;
  {
    const std::scoped_lock lock(mutex_);
    if (talking && now_ns - last_heartbeat_ns_ > std::int64_t{options_.silence.count()} * 1'000'000) {
      status_.state = AutopilotState::Silent;
      status_.problem = fmt::format("{}: system {} has been silent for {:.0f} s", transport_->name(),
                                    self_.system, static_cast<double>(now_ns - last_heartbeat_ns_) * 1e-9);
      ++status_.events["silences"];
      talking = false;
    }
    poses = telemetry_.status(now_ns).poses;
  }
  // Streams are asked for at first and whenever poses have not come since.
  if (!talking || !options_.request_streams || now_ns - last_request_ns_ < kAskAgain_ns) return;
  if (last_request_ns_ != 0 && poses != poses_at_request_) {
    poses_at_request_ = poses;
    last_request_ns_ = now_ns;
    return;
  }
  poses_at_request_ = poses;
  last_request_ns_ = now_ns;
  const std::pair<std::uint32_t, std::int64_t> wanted[] = {
      {mavlink::AttitudeQuaternion::kId, options_.attitude_interval_ns},
      {mavlink::GlobalPositionInt::kId, options_.position_interval_ns},
      {mavlink::GpsRawInt::kId, kSecond / 5},
      {mavlink::SystemTime::kId, kSecond}};
  for (const auto& [id, interval_ns] : wanted) {
    mavlink::CommandLong command;
    command.command = kSetMessageInterval;
    command.param1 = static_cast<float>(id);
    command.param2 = static_cast<float>(interval_ns / 1000);
    command.target_system = options_.telemetry.autopilot.system;
    command.target_component = options_.telemetry.autopilot.component;
    send(command);
  }
}

void Autopilot::send(const OutgoingMessage& message) {
  auto packet = std::visit(
      [&](const auto& m) { return mavlink::encode(m, self_, sequence_, signer_.has_value()); }, message);
  ++sequence_;
  if (signer_) signer_->sign(packet, clockNow(CLOCK_REALTIME) / 1000);
  // A link that is gone says so at the next read.
  (void)transport_->write(packet);
}

AutopilotStatus Autopilot::status() const {
  const std::scoped_lock lock(mutex_);
  AutopilotStatus status = status_;
  status.telemetry = telemetry_.status(clockNow(CLOCK_BOOTTIME));
  if (status.state == AutopilotState::Talking && status.telemetry.poses == 0 &&
      !status.telemetry.dropped.empty()) {
    const auto most = std::max_element(status.telemetry.dropped.begin(), status.telemetry.dropped.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
    status.problem = fmt::format("{}: the autopilot speaks and gives no pose: {}", status.link, most->first);
  }
  return status;
}

std::optional<ClockRecovery::Time> Autopilot::utcOffset(std::int64_t boottime_ns) const {
  const std::scoped_lock lock(mutex_);
  return telemetry_.utcOffset(boottime_ns);
}

VerticalDatum Autopilot::datum() const {
  const std::scoped_lock lock(mutex_);
  return telemetry_.status(0).datum;
}

void Autopilot::setCamera(CameraFacts facts) {
  const std::scoped_lock lock(mutex_);
  camera_.setFacts(std::move(facts));
}

void Autopilot::imageCaptured(const Frame& frame) {
  mavlink::CameraImageCaptured image;
  image.time_boot_ms = bootMs(frame.time_ns);
  image.time_utc = static_cast<std::uint64_t>(
      frame.utc_offset_ns > 0 ? std::max<std::int64_t>(0, (frame.time_ns + frame.utc_offset_ns) / 1000) : 0);
  mavlink::setText(image.file_url, frame.name);
  if (frame.pose) {
    const geo::Geodetic place = geo::geodeticFromEcef(frame.pose->position_in_ecef);
    image.lat = static_cast<std::int32_t>(std::llround(geo::degrees(place.lat) * 1e7));
    image.lon = static_cast<std::int32_t>(std::llround(geo::degrees(place.lon) * 1e7));
    double height_m = place.height_m;
    const auto& geoid = options_.telemetry.geoid;
    if (frame.datum == VerticalDatum::Ellipsoid && geoid)
      height_m = geoid->geoidFromEllipsoidal(place.lat, place.lon, height_m);
    if (std::isfinite(height_m))
      image.alt = static_cast<std::int32_t>(std::llround(std::clamp(height_m, -1e5, 1e6) * 1e3));
    // The camera's axes are right, down, forward; MAVLink's are forward, right, down.
    const Eigen::Matrix3d ned_from_enu{{0, 1, 0}, {1, 0, 0}, {0, 0, -1}};
    const Eigen::Matrix3d camera_from_mount{{0, 1, 0}, {0, 0, 1}, {1, 0, 0}};
    const Eigen::Quaterniond q(ned_from_enu * geo::LocalFrame(place).enuFromEcefRotation() *
                               frame.pose->ecef_from_camera.toRotationMatrix() * camera_from_mount);
    image.q = {static_cast<float>(q.w()), static_cast<float>(q.x()), static_cast<float>(q.y()),
               static_cast<float>(q.z())};
  }
  {
    const std::scoped_lock lock(mutex_);
    image = camera_.captured(image);
    if (outbox_.size() >= kOutbox) outbox_.pop_front();
    outbox_.emplace_back(image);
  }
  wake();
}

void Autopilot::say(std::uint8_t severity, const std::string& text) {
  mavlink::Statustext message;
  message.severity = severity;
  mavlink::setText(message.text, text);
  {
    const std::scoped_lock lock(mutex_);
    if (outbox_.size() >= kOutbox) outbox_.pop_front();
    outbox_.emplace_back(message);
  }
  wake();
}

}  // namespace overfly::capture
