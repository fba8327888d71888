#include <gtest/gtest.h>

#include "tests/integration/live/simulated_flight.h"
#include "tests/unit/capture/frame_source_compliance.h"

namespace overfly::capture {
namespace {

using Flight = SimulatedFlight;

// 15 m/s times 40 ms are 0.6 m: that is the error with a delay that nobody takes off, and centimetres with.
TEST(LiveFlight, TheCamerasDelayIsTakenOff) {
  Flight raw;
  raw.flyFrames(25);
  EXPECT_NEAR(raw.medianError(10), 0.6, 0.08);
  LiveOptions options;
  options.mount.delay_ns = -40 * kMs;
  Flight set(options);
  set.flyFrames(25);
  EXPECT_LT(set.medianError(10), 0.1);
  RecordProperty("error_without_m", std::to_string(raw.medianError(10)));
  RecordProperty("error_with_m", std::to_string(set.medianError(10)));
  for (const FramePtr& frame : set.frames) {
    if (!frame->pose) continue;
    EXPECT_EQ(frame->datum, VerticalDatum::Ellipsoid);
    EXPECT_GT(frame->pose->covariance(0, 0), 0.02 * 0.02 * 0.99);
  }
}

// The same, with nobody saying how long the delay is: pulses of the hot shoe tell.
TEST(LiveFlight, PulsesFindTheDelayThemselves) {
  LiveOptions options;
  options.pulses = PulsesFrom::Gpio;
  Flight flight(options);
  flight.flyFrames(40);
  EXPECT_LT(flight.medianError(20), 0.1);
  const LiveStatus status = flight.source->status();
  ASSERT_TRUE(status.lag);
  EXPECT_NEAR(static_cast<double>(status.lag->ns), 40.5e6, 1.5e6);
  for (std::size_t i = 20; i < flight.frames.size(); ++i)
    EXPECT_LT(std::abs(flight.frames[i]->time_ns - flight.camera->taken(flight.frames[i]->sequence)),
              2 * kMs);
}

TEST(LiveFlight, FramesWithoutAutopilotAreHandedOnWithTheReason) {
  LiveSource::Parts parts;
  parts.camera = std::make_unique<SimulatedCamera>(0);
  LiveSource source(std::move(parts), {});
  ASSERT_TRUE(source.open());
  const auto frame = source.next(5s);
  ASSERT_TRUE(frame && *frame);
  EXPECT_FALSE((*frame)->pose);
  EXPECT_EQ((*frame)->no_pose_reason, "no autopilot");
  EXPECT_EQ(source.status().without_pose.at("no autopilot"), 1U);
}

// A link that stalls for a while and then delivers everything: frames go on without waiting longer than they
// may, and their poses come later, once each.
TEST(LiveFlight, PosesThatComeLateAreHandedOnLater) {
  LiveOptions options;
  options.max_wait_ns = 300 * kMs;
  options.mount.delay_ns = -40 * kMs;
  Flight flight(options);
  flight.fly([&] { return !flight.frames.empty() && flight.frames.back()->pose.has_value(); });
  flight.wire.stalled = true;
  flight.flyFrames(12);
  flight.wire.stalled = false;
  std::vector<FramePtr> without;
  for (const FramePtr& frame : flight.frames)
    if (!frame->pose && frame->no_pose_reason != "before the first pose") without.push_back(frame);
  ASSERT_GE(without.size(), 4U);
  flight.fly([&] { return flight.late_poses.size() >= without.size() - 2; });
  std::map<std::uint64_t, int> times;
  for (const LatePose& late : flight.late_poses) {
    ++times[late.sequence];
    const auto frame = std::find_if(flight.frames.begin(), flight.frames.end(),
                                    [&](const FramePtr& f) { return f->sequence == late.sequence; });
    ASSERT_NE(frame, flight.frames.end());
    EXPECT_LT(flight.errorOf(**frame, late.pose), 0.3);
    EXPECT_EQ(times[late.sequence], 1);
  }
  EXPECT_GE(flight.late_poses.size(), without.size() - 2);
  EXPECT_EQ(flight.source->status().late_poses, flight.late_poses.size());
}

TEST(LiveFlight, ASilentAutopilotIsSaidCountedAndTakenUpAgain) {
  LiveOptions options;
  options.max_wait_ns = 200 * kMs;
  Flight flight(options);
  std::atomic<int> armed{0};
  flight.source->onArmed([&](bool is) { armed += is ? 1 : 0; });
  flight.fly([&] { return !flight.frames.empty() && flight.frames.back()->pose.has_value(); });
  flight.wire.silent = true;
  flight.fly([&] { return flight.source->status().without_pose.contains("the autopilot is silent"); });
  const LiveStatus silent = flight.source->status();
  ASSERT_TRUE(silent.autopilot);
  EXPECT_EQ(silent.autopilot->state, AutopilotState::Silent);
  EXPECT_NE(silent.autopilot->problem.find("has been silent"), std::string::npos)
      << silent.autopilot->problem;
  flight.wire.silent = false;
  flight.wire.armed = true;
  const std::size_t then = flight.frames.size();
  flight.fly([&] { return flight.frames.size() > then && flight.frames.back()->pose.has_value(); });
  EXPECT_TRUE(flight.frames.back()->pose.has_value());
  EXPECT_EQ(flight.source->status().autopilot->problem, "");
  EXPECT_EQ(armed, 1);

  flight.wire.gone = true;
  flight.fly([&] { return flight.source->status().without_pose.contains("no link to the autopilot"); });
  EXPECT_EQ(flight.source->status().autopilot->state, AutopilotState::NoLink);
  flight.wire.gone = false;
  flight.fly([&] { return flight.frames.back()->pose.has_value(); });
  EXPECT_TRUE(flight.frames.back()->pose.has_value());
  EXPECT_GE(flight.source->status().autopilot->events.at("links lost"), 1U);
}

// The autopilot's clock is set an hour back, then it boots anew: no pose is ever wrong, and they go on.
TEST(LiveFlight, AJumpOfTheAutopilotsClockMakesNoWrongPose) {
  LiveOptions options;
  options.max_wait_ns = 200 * kMs;
  options.mount.delay_ns = -40 * kMs;
  Flight flight(options);
  flight.flyFrames(20);
  std::uint64_t jumps = 0;
  for (const std::int64_t boot : {flight.wire.boot_ns + 3600 * kSecond, nowNs() - 5 * kSecond}) {
    flight.wire.boot_ns = boot;
    flight.fly([&] { return flight.source->status().autopilot->telemetry.clock.jumps > jumps; });
    jumps = flight.source->status().autopilot->telemetry.clock.jumps;
    const std::size_t then = flight.frames.size();
    flight.fly([&] { return flight.frames.size() > then + 3 && flight.frames.back()->pose.has_value(); });
    EXPECT_TRUE(flight.frames.back()->pose.has_value());
  }
  std::size_t posed = 0;
  for (const FramePtr& frame : flight.frames) {
    if (!frame->pose) continue;
    ++posed;
    EXPECT_LT(flight.errorOf(*frame, *frame->pose), 0.4) << frame->sequence;
  }
  EXPECT_GT(posed, 15U);
  EXPECT_GT(flight.source->status().autopilot->telemetry.dropped.at("wrong time"), 0U);
}

TEST(LiveFlight, ASecondAutopilotIsCountedAndNotFollowed) {
  LiveOptions options;
  options.mount.delay_ns = -40 * kMs;
  Flight flight(options);
  flight.wire.intruder = true;
  flight.flyFrames(25);
  EXPECT_LT(flight.medianError(10), 0.1);
  EXPECT_GT(flight.source->status().autopilot->events.at("heartbeats of another autopilot, system 2"), 3U);
}

TEST(LiveFlight, WithoutAFixOrTheTimeOfDayItSaysSo) {
  LiveOptions options;
  options.max_wait_ns = 100 * kMs;
  Flight flight(options);
  flight.wire.fix_type = 1;
  flight.wire.knows_utc = false;
  flight.fly([&] { return flight.source->status().without_pose.contains("no position"); });
  const AutopilotStatus status = *flight.source->status().autopilot;
  EXPECT_NE(status.problem.find("gives no pose"), std::string::npos) << status.problem;
  EXPECT_GT(status.telemetry.dropped.at("no position fix"), 0U);
  EXPECT_GT(status.telemetry.dropped.at("no UTC yet"), 0U);
  flight.wire.fix_type = 3;
  flight.fly([&] { return flight.frames.back()->pose.has_value(); });
  EXPECT_TRUE(flight.frames.back()->pose.has_value());
}

// Every kind of FrameSource keeps the same contract.
class Absent final : public CameraSource {
 public:
  Result<void> open() override {
    return fail(ErrorCode::Unavailable, "/dev/video77: no such camera; is it plugged in?");
  }
  Result<FramePtr> next(std::chrono::milliseconds) override { return FramePtr(); }
  void stop() override {}
  void close() override {}
  [[nodiscard]] std::string describe() const override { return "v4l2:/dev/video77"; }
  [[nodiscard]] CameraStatus status() const override { return {}; }
};

std::unique_ptr<FrameSource> sourceOf(std::unique_ptr<CameraSource> camera) {
  static Truth truth;
  static Wire wire;
  LiveSource::Parts parts;
  parts.camera = std::move(camera);
  parts.autopilot = [](Autopilot::Listeners listeners) {
    return std::make_unique<Autopilot>(std::make_unique<SimulatedAutopilot>(truth, wire), autopilotOptions(),
                                       std::move(listeners));
  };
  LiveOptions options;
  options.max_wait_ns = 300 * kMs;
  return std::make_unique<LiveSource>(std::move(parts), options);
}

INSTANTIATE_TEST_SUITE_P(Live, FrameSourceCompliance,
                         testing::Values(SourceKind{
                             "Live", [] { return sourceOf(std::make_unique<SimulatedCamera>(0)); },
                             [] { return sourceOf(std::make_unique<Absent>()); }, 5,
                             std::chrono::milliseconds(60), std::chrono::milliseconds(10000)}),
                         sourceKindName);

}  // namespace
}  // namespace overfly::capture
