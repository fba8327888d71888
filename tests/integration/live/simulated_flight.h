#pragma once
#include <gtest/gtest.h>
#include <time.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <deque>
#include <map>
#include <mutex>
#include <random>
#include <thread>

#include "capture/geo/geodetic.h"
#include "capture/live/live_source.h"
#include "capture/pose/mavlink/parser.h"

// A flight north at 15 m/s, seen by an autopilot at the other end of a link that exists in memory only, and
// by a camera whose stamps lag. The truth is a function of our clock.
namespace overfly::capture {

using namespace std::chrono_literals;
constexpr std::int64_t kMs = 1'000'000, kSecond = 1'000'000'000;

inline std::int64_t nowNs() {
  timespec t{};
  clock_gettime(CLOCK_BOOTTIME, &t);
  return std::int64_t{t.tv_sec} * kSecond + t.tv_nsec;
}

struct Truth {
  std::int64_t start_ns = nowNs();
  double speed = 15;
  geo::LocalFrame local{{geo::radians(47.4), geo::radians(8.5), 500}};
  Eigen::Vector3d at(std::int64_t time_ns) const {
    return local.ecefFromEnu({0, speed * static_cast<double>(time_ns - start_ns) * 1e-9, 0});
  }
};

// What the test turns while the flight goes on.
struct Wire {
  std::atomic<bool> silent{false};                     // nothing is sent
  std::atomic<bool> stalled{false};                    // what is sent waits
  std::atomic<std::int64_t> boot_ns{-3600 * kSecond};  // our time when the autopilot booted
  std::atomic<bool> knows_utc{true};
  std::atomic<bool> intruder{false};  // a second autopilot, system 2, somewhere else
  std::atomic<bool> armed{false};
  std::atomic<int> fix_type{6};
  std::atomic<bool> gone{false};  // the link itself
};

class SimulatedAutopilot final : public Transport {
 public:
  SimulatedAutopilot(const Truth& truth, Wire& wire, std::uint8_t system = 1)
      : truth_(truth), wire_(wire), self_{system, 1} {}

  Result<void> open() override {
    if (wire_.gone) return fail(ErrorCode::Unavailable, "simulated: cannot connect: Connection refused");
    return {};
  }
  void close() override {}
  [[nodiscard]] const std::string& name() const override { return name_; }

  Result<void> read(std::vector<std::uint8_t>& bytes, std::chrono::milliseconds timeout, int) override {
    std::this_thread::sleep_for(std::min(timeout, 5ms));
    if (wire_.gone) return fail(ErrorCode::Unavailable, "simulated is gone: Connection reset by peer");
    const std::int64_t now = nowNs();
    const auto due = [&](std::int64_t& last, std::int64_t interval) {
      if (now - last < interval) return false;
      last = std::max(last + interval, now - interval);
      return true;
    };
    const std::int64_t boot = now - wire_.boot_ns;
    const auto boot_ms = static_cast<std::uint32_t>(boot / kMs);
    // The stamp has whole milliseconds; the state is that moment's.
    const std::int64_t stamped = wire_.boot_ns + boot / kMs * kMs;
    if (due(last_heartbeat_, kSecond / 5))
      send(mavlink::Heartbeat{0, 2, 3, static_cast<std::uint8_t>(wire_.armed ? 128 : 0), 4, 3}, self_);
    if (due(last_time_, kSecond / 5))
      send(mavlink::SystemTime{wire_.knows_utc ? 1'767'225'600'000'000 + static_cast<std::uint64_t>(
                                                                             (now - truth_.start_ns) / 1000)
                                               : 1'000'000,
                               boot_ms},
           self_);
    if (due(last_attitude_, kSecond / 50))
      send(mavlink::AttitudeQuaternion{boot_ms, 1, 0, 0, 0, 0, 0, 0, {}}, self_);
    if (due(last_position_, kSecond / 10)) {
      send(receiver(), self_);
      send(position(boot_ms, stamped), self_);
      if (wire_.intruder) {
        send(mavlink::Heartbeat{0, 2, 3, 0, 4, 3}, {2, 1});
        auto other = position(boot_ms, stamped);
        other.lat += 100'000;
        send(other, {2, 1});
      }
    }
    if (wire_.stalled) return {};
    const std::scoped_lock lock(mutex_);
    bytes.insert(bytes.end(), sent_.begin(), sent_.end());
    sent_.clear();
    return {};
  }

  Result<void> write(std::span<const std::uint8_t> packet) override {
    parser_.feed(packet, [&](const mavlink::Packet& p, std::span<const std::uint8_t>) {
      if (p.info->id != mavlink::Timesync::kId) return;
      const auto question = mavlink::decode<mavlink::Timesync>(p);
      if (question.tc1 == 0) send(mavlink::Timesync{nowNs() - wire_.boot_ns, question.ts1, 0, 0}, self_);
    });
    return {};
  }

 private:
  template <class M>
  void send(const M& message, mavlink::Address from) {
    if (wire_.silent) return;
    const auto packet = mavlink::encode(message, from, sequence_[from]++);
    const std::scoped_lock lock(mutex_);
    sent_.insert(sent_.end(), packet.begin(), packet.end());
  }
  mavlink::GpsRawInt receiver() const {
    mavlink::GpsRawInt m;
    m.fix_type = static_cast<std::uint8_t>(wire_.fix_type.load());
    m.alt = 453'000;
    m.alt_ellipsoid = 500'000;
    m.h_acc = m.v_acc = 20;
    return m;
  }
  mavlink::GlobalPositionInt position(std::uint32_t boot_ms, std::int64_t time_ns) const {
    const geo::Geodetic place = geo::geodeticFromEcef(truth_.at(time_ns));
    mavlink::GlobalPositionInt m;
    m.time_boot_ms = boot_ms;
    m.lat = static_cast<std::int32_t>(std::lround(geo::degrees(place.lat) * 1e7));
    m.lon = static_cast<std::int32_t>(std::lround(geo::degrees(place.lon) * 1e7));
    m.alt = static_cast<std::int32_t>(std::lround((place.height_m - 47) * 1e3));
    m.vx = static_cast<std::int16_t>(truth_.speed * 100);
    return m;
  }

  const Truth& truth_;
  Wire& wire_;
  const mavlink::Address self_;
  const std::string name_ = "simulated";
  std::mutex mutex_;
  std::vector<std::uint8_t> sent_;
  mavlink::Parser parser_;
  std::map<mavlink::Address, std::uint8_t> sequence_;
  std::int64_t last_heartbeat_ = 0, last_time_ = 0, last_attitude_ = 0, last_position_ = 0;
};

// 10 frames a second; the stamps lag by `lag_ns` and wander by a millisecond. Pulses are what a hot shoe
// would give.
class SimulatedCamera final : public CameraSource {
 public:
  explicit SimulatedCamera(std::int64_t lag_ns) : lag_ns_(lag_ns) {}
  Result<void> open() override {
    const std::scoped_lock lock(mutex_);
    stopped_ = false;
    next_ns_ = nowNs() + 20 * kMs;
    return {};
  }
  Result<FramePtr> next(std::chrono::milliseconds timeout) override {
    const std::int64_t deadline = nowNs() + timeout.count() * kMs;
    const std::int64_t ready = next_ns_ + lag_ns_ + 2 * kMs;
    while (nowNs() < ready) {
      {
        const std::scoped_lock lock(mutex_);
        if (stopped_) return FramePtr();
        if (pulses_.empty() || pulses_.back() < next_ns_)
          if (nowNs() > next_ns_) pulses_.push_back(next_ns_);
      }
      if (nowNs() > deadline) return fail(ErrorCode::Unavailable, "no frame yet");
      std::this_thread::sleep_for(1ms);
    }
    const std::scoped_lock lock(mutex_);
    if (stopped_) return FramePtr();
    if (pulses_.empty() || pulses_.back() < next_ns_) pulses_.push_back(next_ns_);
    auto frame = std::make_shared<Frame>();
    frame->sequence = sequence_++;
    frame->name = std::to_string(frame->sequence) + ".grey8";
    frame->camera_id = "cam0";
    frame->time_ns = next_ns_ + lag_ns_ + static_cast<std::int64_t>(random_() % 1'000'000);
    frame->time_sigma_ns = 300'000;
    frame->image = {PixelFormat::Grey8, 8, 8, 8, std::vector<std::uint8_t>(64, 128)};
    frame->camera.width = frame->camera.height = 8;
    frame->camera.fx = frame->camera.fy = 8;
    frame->camera.cx = frame->camera.cy = 4;
    taken_[frame->sequence] = next_ns_;
    next_ns_ += 90 * kMs + static_cast<std::int64_t>(random_() % 20) * kMs;
    return FramePtr(std::move(frame));
  }
  void stop() override {
    const std::scoped_lock lock(mutex_);
    stopped_ = true;
  }
  void close() override {}
  [[nodiscard]] std::string describe() const override { return "simulated:camera"; }
  [[nodiscard]] CameraStatus status() const override { return {}; }

  // When a frame was really taken.
  std::int64_t taken(std::uint64_t sequence) const {
    const std::scoped_lock lock(mutex_);
    return taken_.at(sequence);
  }
  // Pulses since the last call.
  std::vector<std::int64_t> takePulses() {
    const std::scoped_lock lock(mutex_);
    return std::exchange(pulses_, {});
  }

 private:
  const std::int64_t lag_ns_;
  mutable std::mutex mutex_;
  bool stopped_ = false;
  std::uint64_t sequence_ = 0;
  std::int64_t next_ns_ = 0;
  std::map<std::uint64_t, std::int64_t> taken_;
  std::vector<std::int64_t> pulses_;
  std::minstd_rand random_{1};
};

// The hot shoe's line, wired to the camera above.
class HotShoe final : public EdgeLines {
 public:
  explicit HotShoe(SimulatedCamera& camera) : camera_(camera) {}
  Result<std::vector<GpioEdge>> wait(std::chrono::milliseconds) override {
    std::this_thread::sleep_for(2ms);
    std::vector<GpioEdge> edges;
    for (const std::int64_t pulse : camera_.takePulses()) edges.push_back({nowNs(), 5, true, 0, pulse});
    return edges;
  }

 private:
  SimulatedCamera& camera_;
};

inline AutopilotOptions autopilotOptions() {
  AutopilotOptions options;
  options.retry = 50ms;
  options.silence = 600ms;
  options.telemetry.attitude_sigma = 0.01;
  return options;
}

// Autopilot, camera and hot shoe joined, on the way north.
struct SimulatedFlight {
  explicit SimulatedFlight(LiveOptions options = {}, std::int64_t lag_ns = 40 * kMs,
                           AutopilotOptions autopilot = autopilotOptions()) {
    auto made = std::make_unique<SimulatedCamera>(lag_ns);
    camera = made.get();
    LiveSource::Parts parts;
    parts.camera = std::move(made);
    parts.autopilot = [this, autopilot](Autopilot::Listeners listeners) {
      return std::make_unique<Autopilot>(std::make_unique<SimulatedAutopilot>(truth, wire), autopilot,
                                         std::move(listeners));
    };
    if (options.pulses == PulsesFrom::Gpio) {
      GpioStampsOptions gpio;
      gpio.exposure = {5, true};
      parts.gpio = [this, gpio](GpioStamps::Listeners listeners) {
        return std::make_unique<GpioStamps>(
            gpio, std::move(listeners),
            [this](const std::vector<LineWanted>&) -> Result<std::unique_ptr<EdgeLines>> {
              return std::make_unique<HotShoe>(*camera);
            });
      };
    }
    source = std::make_unique<LiveSource>(std::move(parts), options);
    EXPECT_TRUE(source->open());
  }

  // Frames until `enough`, at most for half a minute.
  template <class Enough>
  void fly(Enough&& enough) {
    const std::int64_t end = nowNs() + 30 * kSecond;
    while (nowNs() < end && !enough()) {
      const auto frame = source->next(100ms);
      for (LatePose& late : source->takeLatePoses()) late_poses.push_back(std::move(late));
      if (frame && *frame) frames.push_back(*frame);
    }
  }
  void flyFrames(std::size_t count) {
    const std::size_t target = frames.size() + count;
    fly([&] { return frames.size() >= target; });
  }
  double errorOf(const Frame& frame, const Pose& pose) const {
    return (pose.position_in_ecef - truth.at(camera->taken(frame.sequence))).norm();
  }
  double medianError(std::size_t from) const {
    std::vector<double> errors;
    for (std::size_t i = from; i < frames.size(); ++i)
      if (frames[i]->pose) errors.push_back(errorOf(*frames[i], *frames[i]->pose));
    std::sort(errors.begin(), errors.end());
    return errors.empty() ? 1e9 : errors[errors.size() / 2];
  }

  Truth truth;
  Wire wire;
  SimulatedCamera* camera = nullptr;
  std::unique_ptr<LiveSource> source;
  std::vector<FramePtr> frames;
  std::vector<LatePose> late_poses;
};

}  // namespace overfly::capture
