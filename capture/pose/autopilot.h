#pragma once
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "capture/pose/camera_component.h"
#include "capture/pose/mavlink/parser.h"
#include "capture/pose/mavlink/signer.h"
#include "capture/pose/telemetry_poses.h"
#include "capture/pose/transport.h"
#include "capture/pose_track.h"
#include "capture/record/files.h"
#include "capture/record/raw_log.h"

namespace overfly::capture {

struct AutopilotOptions {
  TelemetryOptions telemetry;
  PoseTrackOptions track;
  std::uint8_t component_id = 100;  // MAV_COMP_ID_CAMERA; our system is the autopilot's
  std::optional<mavlink::Key> key;  // absent: nothing is signed, signatures are not looked at
  bool request_streams = true;      // asks for the messages that poses need (SET_MESSAGE_INTERVAL)
  std::int64_t attitude_interval_ns = 20'000'000, position_interval_ns = 100'000'000;
  std::chrono::milliseconds silence{3000};  // without a heartbeat: the autopilot counts as silent
  std::chrono::milliseconds retry{1000};    // before a link that is gone is opened again
};

enum class AutopilotState { NoLink, Silent, Talking };

struct AutopilotStatus {
  AutopilotState state = AutopilotState::NoLink;
  std::string link;
  std::string problem;  // one sentence for a person while state is not Talking, or telemetry is of no use
  bool armed = false;
  mavlink::ParserCounts packets;
  // Heartbeats of other autopilots, packets from strange addresses, refused signatures, silences, links lost,
  // commands answered: by name.
  std::map<std::string, std::uint64_t> events;
  TelemetryStatus telemetry;
};

// A pulse that the autopilot reports (CAMERA_TRIGGER, CAMERA_FEEDBACK), on our clock.
struct ReportedPulse {
  std::int64_t time_ns = 0, sigma_ns = 0;
  bool feedback = false;  // the camera's hot shoe; else the order to release
};

// The link to the autopilot: one thread that opens the transport, and again whenever it goes; reads; says
// that we are there; recovers the clocks; fills the pose track; answers as a camera. Public calls from any
// thread.
class Autopilot {
 public:
  // Listeners are called on the link's thread and must return at once.
  struct Listeners {
    std::function<void(const RawInput&)> raw;  // what came, for the recording
    std::function<void(bool armed)> armed;     // when it changes, and at the first heartbeat
    std::function<void(const ReportedPulse&)> pulse;
  };

  Autopilot(std::unique_ptr<Transport> transport, AutopilotOptions options, Listeners listeners = {});
  ~Autopilot();  // stops
  Autopilot(const Autopilot&) = delete;
  Autopilot& operator=(const Autopilot&) = delete;

  void start();
  void stop();

  [[nodiscard]] const PoseTrack& poses() const { return track_; }
  [[nodiscard]] AutopilotStatus status() const;
  // Add to our time for UTC; nullopt until the autopilot knows.
  [[nodiscard]] std::optional<ClockRecovery::Time> utcOffset(std::int64_t boottime_ns) const;
  [[nodiscard]] VerticalDatum datum() const;

  void setCamera(CameraFacts facts);
  // A frame was taken: CAMERA_IMAGE_CAPTURED goes out. The pose may be absent.
  void imageCaptured(const Frame& frame);
  // A line for the operator's screen; cut to 50 bytes. Severity as MAV_SEVERITY (4 warning, 6 info).
  void say(std::uint8_t severity, const std::string& text);

 private:
  void run(const std::stop_token& stop);
  void serve(const std::stop_token& stop);
  void take(const mavlink::Packet& packet, std::span<const std::uint8_t> raw, std::int64_t arrival_ns);
  void takeHeartbeat(const mavlink::Packet& packet, std::int64_t arrival_ns);
  void takeTimesync(const mavlink::Packet& packet, std::int64_t arrival_ns);
  void everySecond(std::int64_t now_ns);
  void send(const OutgoingMessage& message);
  void wake() const;

  const std::unique_ptr<Transport> transport_;
  const AutopilotOptions options_;
  const Listeners listeners_;
  const mavlink::Address self_;
  PoseTrack track_;

  mutable std::mutex mutex_;  // guards what follows, down to the thread's own
  TelemetryPoses telemetry_;
  CameraComponent camera_;
  AutopilotStatus status_;
  std::deque<OutgoingMessage> outbox_;

  // The thread's own.
  mavlink::Parser parser_;
  std::optional<mavlink::Signer> signer_;
  std::uint8_t sequence_ = 0;
  bool link_lost_ = false;
  std::int64_t last_heartbeat_ns_ = 0, last_second_ns_ = 0, last_timesync_ns_ = 0, last_request_ns_ = 0;
  std::uint64_t poses_at_request_ = 0;
  std::int64_t asked_ns_ = 0;  // stamp of the last TIMESYNC question
  int timesyncs_ = 0;
  bool knows_armed_ = false;

  FileDescriptor wake_read_, wake_write_;
  std::jthread thread_;
};

[[nodiscard]] const char* nameOf(AutopilotState state);

}  // namespace overfly::capture
