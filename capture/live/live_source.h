#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "capture/camera_source.h"
#include "capture/gpio/gpio_stamps.h"
#include "capture/gpio/pulse_matcher.h"
#include "capture/pose/autopilot.h"

namespace overfly::capture {

// Which pulses stamp the frames.
enum class PulsesFrom { None, Gpio, Trigger, Feedback };

struct LiveOptions {
  CameraMount mount;                         // boresight and delay; the lever arm is the autopilot's
  std::int64_t max_wait_ns = 1'000'000'000;  // for a pose, before a frame is handed on without
  std::int64_t rolling_shutter_ns = 0;       // first row to last row
  PulsesFrom pulses = PulsesFrom::None;
  PulseMatcherOptions matcher;
};

struct LiveStatus {
  CameraStatus camera;
  std::optional<AutopilotStatus> autopilot;
  std::optional<GpioStatus> gpio;
  std::optional<TriggerStatus> trigger;
  std::uint64_t with_pose = 0;
  std::uint64_t late_poses = 0;                       // came after their frames
  std::map<std::string, std::uint64_t> without_pose;  // by reason (Frame::no_pose_reason)
  PulseCounts pulses;
  std::optional<PulseMatcher::Lag> lag;  // of the camera's stamps behind the pulses
  std::optional<std::int64_t> utc_offset_ns;
  std::int64_t utc_sigma_ns = 0;
};

// Joins a camera, an autopilot and pulses into frames with poses. A frame waits for the pose at its time, and
// for the pulse that stamps it; what does not come in time leaves it without a pose and with a reason, and is
// handed on later by takeLatePoses(). Nothing is extrapolated: a pose lies between two that the autopilot
// sent. Reasons: "no autopilot", "no link to the autopilot", "the autopilot is silent", "no position", "poses
// come late", "a gap in the poses", "before the first pose". FrameSource's thread rule; status() and setRaw()
// from any thread.
class LiveSource final : public FrameSource {
 public:
  // What is absent is null. `make_gpio` and `make_autopilot` get the listeners that they are to call.
  struct Parts {
    std::unique_ptr<CameraSource> camera;
    std::function<std::unique_ptr<Autopilot>(Autopilot::Listeners)> autopilot;
    std::function<std::unique_ptr<GpioStamps>(GpioStamps::Listeners)> gpio;
    std::unique_ptr<TriggerOutput> trigger;
  };
  LiveSource(Parts parts, LiveOptions options);
  ~LiveSource() override;

  [[nodiscard]] Result<void> open() override;
  [[nodiscard]] Result<FramePtr> next(std::chrono::milliseconds timeout) override;
  [[nodiscard]] std::vector<LatePose> takeLatePoses() override;
  void stop() override;
  void close() override;
  [[nodiscard]] std::string describe() const override;

  [[nodiscard]] LiveStatus status() const;
  // Where the raw inputs go (telemetry, edges, clock pairs), on whatever thread they come.
  void onRaw(std::function<void(const RawInput&)> listener);
  // When the vehicle is armed or disarmed, on the autopilot's thread.
  void onArmed(std::function<void(bool armed)> listener);
  // A line for the operator's screen, when there is an autopilot.
  void say(std::uint8_t severity, const std::string& text);

 private:
  struct Pending {
    std::shared_ptr<Frame> frame;
    std::int64_t arrived_ns = 0;
    bool stamped = false;
  };
  struct Awaiting {
    std::string camera_id;
    std::uint64_t sequence = 0;
    std::int64_t time_ns = 0;
    std::int64_t time_sigma_ns = 0;
  };

  // True when the first pending frame can go.
  bool settleFront(std::int64_t now_ns, bool hurry);
  void stamp(Pending& pending);
  [[nodiscard]] Result<Pose> poseAt(std::int64_t time_ns, std::int64_t sigma_ns) const;
  FramePtr takeFront();
  void collectLate();
  void addPulse(std::int64_t time_ns, std::int64_t sigma_ns);
  void addPps(std::int64_t edge_ns);
  [[nodiscard]] std::optional<ClockRecovery::Time> utcOffset(std::int64_t time_ns) const;
  [[nodiscard]] const char* reasonNow() const;

  const LiveOptions options_;
  std::unique_ptr<CameraSource> camera_;

  mutable std::mutex mutex_;  // guards what follows, up to the source's own thread's
  PulseMatcher matcher_;
  std::int64_t quiet_ns_ = 0;  // pulses up to here have been told
  ClockRecovery utc_by_pps_;
  LiveStatus status_;
  std::function<void(bool)> on_armed_;
  std::optional<bool> armed_;
  bool stopped_ = false;

  std::mutex raw_mutex_;  // the recording may take its time, and then only what records waits
  std::function<void(const RawInput&)> on_raw_;

  // Of the thread that calls next().
  std::deque<Pending> pending_;
  std::deque<Awaiting> awaiting_;
  std::vector<LatePose> late_;
  std::map<std::string, std::int64_t> last_time_ns_;  // handed on, by camera
  CameraFacts told_;                                  // what the ground is told of the camera

  // Last, so that their threads end before what they call is gone.
  std::unique_ptr<Autopilot> autopilot_;
  std::unique_ptr<GpioStamps> gpio_;
  std::unique_ptr<TriggerOutput> trigger_;
};

}  // namespace overfly::capture
