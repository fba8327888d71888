#include <gtest/gtest.h>

#include <thread>

#include "tests/integration/daemon/daemon_process.h"
#include "tests/integration/daemon/pipeline_fixture.h"
#include "tests/stress/hard_case/hard_case.h"
#include "tiling/store/map_store.h"

// Every stage made slow, stuck or broken.
namespace overfly::test {
namespace {

using namespace std::chrono_literals;
using daemon::Pipeline;
using daemon::Stage;

class Queue : public ::testing::Test {
 protected:
  void SetUp() override {
    if (smokeFlight().empty()) GTEST_SKIP() << "the flight brighton-beach-smoke is not here";
  }

  // Frames of the smoke flight that the only mission's map lacks, or tiles that do not read back whole.
  static double lostIn(const DaemonProcess& daemon) {
    const auto reader = tiling::MapReader::open(daemon.missions() / daemon.missionNames()[0] / "map.overfly");
    if (!reader) return 1e9;
    const auto mapped =
        reader->statistics().value().frames[static_cast<std::size_t>(tiling::FrameState::Mapped)];
    return static_cast<double>(kSmokeFrames - mapped) + static_cast<double>(reader->verify().value().size());
  }
};

constexpr auto kAdjustAlways = "[adjust]\nmode = \"always\"\n";

TEST_F(Queue, SlowStagesLoseNothing) {
  const auto gl = glThread();
  double lost = 0;
  for (const Stage slow : {Stage::Capture, Stage::Adjusting, Stage::Mapping, Stage::Encoding}) {
    const PipelineFolder folder;
    Pipeline pipeline(settingsHere(), smokeSource(0, slow == Stage::Adjusting), folder.path, *gl);
    std::atomic<int> pauses = 0;
    pipeline.setStageHook([&pauses, slow](Stage stage, std::uint64_t) {
      if (stage != slow) return;
      ++pauses;
      std::this_thread::sleep_for(30ms);
    });
    ASSERT_TRUE(pipeline.start());
    ASSERT_TRUE(waitUntilMapped(pipeline)) << pipeline.status().error;
    EXPECT_GE(pauses, static_cast<int>(kSmokeFrames));
    EXPECT_TRUE(pipeline.status().stuck.empty());
    lost += static_cast<double>(kSmokeFrames - pipeline.status().mapped);
  }
  expectAtMost("queue/slow", "frames lost, each of four stages slow in its turn", lost, 0);
}

TEST_F(Queue, AStageThatThrowsLosesNothing) {
  double lost = 0;
  for (const std::string stage : {"capture", "adjusting", "mapping", "encoding"}) {
    SCOPED_TRACE(stage);
    DaemonProcess daemon(0, stage == "adjusting" ? kAdjustAlways : "");
    daemon.start({"--inject-fault", stage + ":throw@4"});
    EXPECT_EQ(daemon.wait(240s), 1);
    EXPECT_NE(daemon.log().find("the " + stage + " stage broke"), std::string::npos) << daemon.log();
    daemon.start({"--exit-when-done"});
    ASSERT_EQ(daemon.wait(240s), 0) << daemon.log();
    lost += lostIn(daemon);
  }
  expectAtMost("queue/throw", "frames or tiles lost after a restart, four stages", lost, 0);
}

TEST_F(Queue, AStuckStageIsSeenAndLosesNothing) {
  double lost = 0, unseen = 0;
  for (const std::string stage : {"capture", "adjusting", "mapping", "encoding"}) {
    SCOPED_TRACE(stage);
    DaemonProcess daemon(0, stage == "adjusting" ? kAdjustAlways : "");
    daemon.start({"--inject-fault", stage + ":stuck@4"});
    const bool seen = daemon.waitFor(
        [&](const auto& s) { return s["stuck"].is_array() && s["stuck"] == nlohmann::json::array({stage}); },
        90s);
    unseen += seen ? 0 : 1;
    EXPECT_TRUE(seen) << stage << ": " << daemon.status().dump();
    daemon.send(SIGKILL);  // what systemd's watchdog does
    (void)daemon.wait(10s);
    daemon.start({"--exit-when-done"});
    ASSERT_EQ(daemon.wait(240s), 0) << daemon.log();
    lost += lostIn(daemon);
  }
  expectAtMost("queue/stuck", "stuck stages not named within 90 s", unseen, 0);
  expectAtMost("queue/stuck", "frames or tiles lost after a kill and a restart", lost, 0);
}

}  // namespace
}  // namespace overfly::test
