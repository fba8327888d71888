#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <thread>

#include "capture/replay/replay_source.h"
#include "tests/integration/flight/made_frames.h"

namespace overfly::capture {
namespace {

using namespace testing_data;
using std::chrono::milliseconds;

ReplayOptions fast() {
  ReplayOptions options;
  options.speed = 0;
  return options;
}

TEST(RecordReplay, TheMockCameraGivesTheRecordedFramesBack) {
  const TemporaryFolder folder;
  {
    auto recorder = FlightRecorder::create(folder / "flight", {}).value();
    for (std::uint64_t i = 0; i < 30; ++i) {
      const PixelFormat format = i % 3 == 1   ? PixelFormat::Rgb8
                                 : i % 3 == 2 ? PixelFormat::Grey8
                                              : PixelFormat::Jpeg;
      ASSERT_TRUE(recorder.record(madeFrame(i, format)));
    }
    EXPECT_EQ(recorder.framesRecorded(), 30u);
    ASSERT_TRUE(recorder.close());
    EXPECT_EQ(recorder.record(madeFrame(31)).error().code, ErrorCode::Unavailable);
  }
  ReplaySource source(folder / "flight", fast());
  ASSERT_TRUE(source.open());
  for (std::uint64_t i = 0; i < 30; ++i) {
    const auto frame = source.next(milliseconds(1000));
    ASSERT_TRUE(frame && *frame) << i;
    EXPECT_TRUE(same(**frame, madeFrame(i, i % 3 == 1   ? PixelFormat::Rgb8
                                           : i % 3 == 2 ? PixelFormat::Grey8
                                                        : PixelFormat::Jpeg)))
        << i;
  }
  EXPECT_EQ(*source.next(milliseconds(100)), nullptr);
  EXPECT_TRUE(source.flight()->warnings().empty());
}

TEST(RecordReplay, RawInputsComeBack) {
  const TemporaryFolder folder;
  const std::vector<RawInput> inputs = {TelemetryPacket{17, 2, {1, 2, 3}}, GpioEdge{18, 4, false, 7, -5},
                                        ClockPair{19, DeviceClock::Camera, 1, 2, 3},
                                        TelemetryPacket{20, 0, {}}};
  {
    auto recorder = FlightRecorder::create(folder / "flight", {}).value();
    for (const RawInput& input : inputs) ASSERT_TRUE(recorder.record(input));
    TelemetryPacket large;
    large.bytes.resize(70000);
    EXPECT_EQ(recorder.record(large).error().code, ErrorCode::BadInput);
  }
  const auto log = readRawLog(folder / "flight");
  ASSERT_TRUE(log);
  EXPECT_EQ(log->inputs, inputs);
  EXPECT_EQ(log->skipped, 0u);
  EXPECT_EQ(log->cut_bytes, 0u);
}

TEST(RecordReplay, AFolderThatHoldsSomethingIsNeverWrittenInto) {
  const TemporaryFolder folder;
  std::ofstream(folder / "mine.txt") << "mine";
  EXPECT_EQ(FlightRecorder::create(folder.path(), {}).error().code, ErrorCode::BadInput);
  EXPECT_FALSE(std::filesystem::exists(folder / "flight.json"));
}

TEST(RecordReplay, ACameraThatChangesKeepsBothModels) {
  const TemporaryFolder folder;
  Frame first = madeFrame(0), second = madeFrame(1), third = madeFrame(2);
  second.camera.fx += 1;
  {
    auto recorder = FlightRecorder::create(folder / "flight", {}).value();
    for (const Frame* frame : {&first, &second, &third}) ASSERT_TRUE(recorder.record(*frame));
  }
  const auto flight = Flight::open(folder / "flight");
  ASSERT_TRUE(flight);
  EXPECT_EQ(flight->cameras().size(), 2u);
  EXPECT_TRUE(same(**flight->load(1), second));
  EXPECT_TRUE(same(**flight->load(2), third));
}

TEST(RecordReplay, NamesThatAreNotFileNamesStayInTheFolder) {
  const TemporaryFolder folder;
  {
    auto recorder = FlightRecorder::create(folder / "flight", {}).value();
    for (const char* name : {"../../evil.jpg", "", ".hidden", "a/b.jpg", "twice.jpg", "twice.jpg"}) {
      static std::uint64_t i = 0;
      Frame frame = madeFrame(i++);
      frame.name = name;
      ASSERT_TRUE(recorder.record(frame));
    }
  }
  const auto flight = Flight::open(folder / "flight").value();
  ASSERT_EQ(flight.size(), 6u);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_TRUE(flight.load(i)) << i;
    EXPECT_EQ(std::filesystem::path(flight.at(i).file).parent_path(), folder / "flight" / "images");
  }
}

// How often; ./tests/run keeps it at 50.
int kills() {
  const char* text = std::getenv("OVERFLY_RECORDER_KILLS");
  return text ? std::atoi(text) : 50;
}

TEST(RecordReplay, AKilledRecorderLeavesWholeFrames) {
  const unsigned seed = 20;
  std::mt19937 random(seed);
  std::size_t most = 0, with_frames = 0;
  for (int kill = 0; kill < kills(); ++kill) {
    const TemporaryFolder folder;
    const std::string target = folder / "flight";
    int ready[2];
    ASSERT_EQ(::pipe(ready), 0);
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      ::dup2(ready[1], STDOUT_FILENO);
      ::execl(OVERFLY_VICTIM, OVERFLY_VICTIM, target.c_str(), nullptr);
      ::_exit(127);
    }
    ::close(ready[1]);
    char byte = 0;
    ASSERT_EQ(::read(ready[0], &byte, 1), 1);
    ::close(ready[0]);
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 120000));
    ASSERT_EQ(::kill(child, SIGKILL), 0);
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status)) << "the victim ended by itself";

    if (!std::filesystem::exists(folder / "flight/flight.json")) continue;  // killed before the flight began
    ReplaySource source(target, fast());
    ASSERT_TRUE(source.open()) << "kill " << kill;
    EXPECT_EQ(source.flight()->skipped(), 0u) << "kill " << kill;
    std::uint64_t count = 0;
    for (;; ++count) {
      const auto frame = source.next(milliseconds(1000));
      ASSERT_TRUE(frame) << "kill " << kill << ": " << frame.error().message;
      if (!*frame) break;
      ASSERT_TRUE(same(**frame, madeFrame(count))) << "kill " << kill << " frame " << count;
    }
    // Every image with its final name has its line, but for the last.
    std::size_t images = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder / "flight/images")) {
      images += entry.path().filename().string().starts_with('.') ? 0 : 1;
    }
    EXPECT_LE(images, count + 1);
    const auto log = readRawLog(target);
    ASSERT_TRUE(log);
    EXPECT_EQ(log->skipped, 0u);
    EXPECT_GE(log->inputs.size() + 1, count);
    most = std::max<std::size_t>(most, count);
    with_frames += count > 0 ? 1 : 0;
  }
  EXPECT_GT(most, 10u);
  EXPECT_GT(with_frames, static_cast<std::size_t>(kills()) / 4);
}

TEST(Replay, AtTrueTimeFramesComeWhenTheyWereTaken) {
  const TemporaryFolder folder;
  {
    auto recorder = FlightRecorder::create(folder / "flight", {}).value();
    for (std::uint64_t i = 0; i < 6; ++i) ASSERT_TRUE(recorder.record(madeFrame(i)));
  }
  for (const double speed : {1.0, 4.0}) {
    ReplayOptions options;
    options.speed = speed;
    ReplaySource source(folder / "flight", options);
    ASSERT_TRUE(source.open());
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < 6; ++i) ASSERT_TRUE(*source.next(milliseconds(1000)));
    const double took = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    EXPECT_GE(took, 0.5 / speed - 0.001);
    EXPECT_LT(took, 0.5 / speed + 0.4);  // a busy machine is late, never early
  }
}

TEST(Replay, LoopingTimesAndNumbersGoOnIncreasing) {
  const TemporaryFolder folder;
  {
    auto recorder = FlightRecorder::create(folder / "flight", {}).value();
    for (std::uint64_t i = 0; i < 5; ++i) ASSERT_TRUE(recorder.record(madeFrame(i)));
  }
  ReplayOptions options = fast();
  options.loop = true;
  options.start = 3;
  ReplaySource source(folder / "flight", options);
  ASSERT_TRUE(source.open());
  std::int64_t time = 0;
  std::uint64_t sequence = 2;
  for (int i = 0; i < 40; ++i) {
    const auto frame = source.next(milliseconds(1000)).value();
    ASSERT_TRUE(frame);
    EXPECT_GT(frame->time_ns, time);
    EXPECT_EQ(frame->sequence, sequence + 1);
    EXPECT_EQ(frame->name, madeFrame((3 + static_cast<std::uint64_t>(i)) % 5).name);
    EXPECT_TRUE(!frame->pose || frame->pose->time_ns == frame->time_ns);
    time = frame->time_ns;
    sequence = frame->sequence;
  }
}

struct Played {
  std::vector<std::uint64_t> sequences;
  int unreadable = 0, without_pose = 0;
};

Played play(const std::filesystem::path& folder, const ReplayFaults& faults) {
  ReplayOptions options = fast();
  options.faults = faults;
  ReplaySource source(folder, options);
  EXPECT_TRUE(source.open());
  Played played;
  for (;;) {
    const auto frame = source.next(milliseconds(1000));
    if (!frame || !*frame) break;
    played.sequences.push_back((*frame)->sequence);
    played.unreadable += decodeImage((*frame)->image, PixelFormat::Grey8) ? 0 : 1;
    played.without_pose += (*frame)->pose ? 0 : 1;
  }
  return played;
}

TEST(Replay, FaultsComeWhenAskedForAndTheSameForTheSameSeed) {
  const TemporaryFolder folder;
  {
    auto recorder = FlightRecorder::create(folder / "flight", {}).value();
    for (std::uint64_t i = 0; i < 200; ++i) {
      Frame frame = madeFrame(i);
      frame.pose = madeFrame(0).pose;
      ASSERT_TRUE(recorder.record(frame));
    }
  }
  const auto path = folder / "flight";
  ReplayFaults faults;
  const Played whole = play(path, faults);
  EXPECT_EQ(whole.sequences.size(), 200u);
  EXPECT_EQ(whole.unreadable + whole.without_pose, 0);
  faults.drop = 0.2;
  const Played dropped = play(path, faults);
  EXPECT_NEAR(static_cast<double>(dropped.sequences.size()), 160, 25);
  EXPECT_TRUE(std::is_sorted(dropped.sequences.begin(), dropped.sequences.end()));
  EXPECT_EQ(play(path, faults).sequences, dropped.sequences);
  faults.seed = 2;
  EXPECT_NE(play(path, faults).sequences, dropped.sequences);
  faults = {};
  faults.duplicate = 0.2;
  EXPECT_NEAR(static_cast<double>(play(path, faults).sequences.size()), 240, 25);
  faults = {};
  faults.reorder = 0.2;
  const Played reordered = play(path, faults);
  EXPECT_EQ(reordered.sequences.size(), 200u);
  EXPECT_FALSE(std::is_sorted(reordered.sequences.begin(), reordered.sequences.end()));
  faults = {};
  faults.lose_pose = 0.3;
  EXPECT_NEAR(play(path, faults).without_pose, 60, 25);
  faults = {};
  faults.corrupt_jpeg = 0.5;
  EXPECT_GT(play(path, faults).unreadable, 50);
}

TEST(Replay, AStallIsSilenceAndThenTheFrame) {
  const TemporaryFolder folder;
  {
    auto recorder = FlightRecorder::create(folder / "flight", {}).value();
    ASSERT_TRUE(recorder.record(madeFrame(0)));
  }
  ReplayOptions options = fast();
  options.faults.stall = 1;
  options.faults.stall_time = milliseconds(200);
  ReplaySource source(folder / "flight", options);
  ASSERT_TRUE(source.open());
  EXPECT_EQ(source.next(milliseconds(20)).error().code, ErrorCode::Unavailable);
  const auto frame = source.next(milliseconds(2000));
  ASSERT_TRUE(frame);
  EXPECT_TRUE(*frame);
}

}  // namespace
}  // namespace overfly::capture
