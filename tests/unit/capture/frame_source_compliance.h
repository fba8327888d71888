#pragma once
#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>

#include "capture/frame_source.h"

// What every kind of FrameSource must keep (capture/frame_source.h). A kind joins by
//
//   INSTANTIATE_TEST_SUITE_P(Replay, FrameSourceCompliance, testing::Values(SourceKind{...}),
//   sourceKindName);
//
// in its own test program. Kinds whose device is not there are left out by the caller, not skipped here.
namespace overfly::capture {

struct SourceKind {
  std::string name;
  // A source that yields at least `frames` frames, none faulty.
  std::function<std::unique_ptr<FrameSource>()> make;
  // A source of the same kind whose device or file does not exist.
  std::function<std::unique_ptr<FrameSource>()> make_absent;
  int frames = 5;
  // Mean time between frames at the source's own pace; 0: as fast as they are taken.
  std::chrono::milliseconds interval{0};
  std::chrono::milliseconds patience{5000};  // longest wait for one frame on a busy machine
};

inline std::string sourceKindName(const testing::TestParamInfo<SourceKind>& test) { return test.param.name; }

class FrameSourceCompliance : public testing::TestWithParam<SourceKind> {
 protected:
  using Clock = std::chrono::steady_clock;
  const SourceKind& kind() const { return GetParam(); }
  std::unique_ptr<FrameSource> source_ = GetParam().make();
};

TEST_P(FrameSourceCompliance, FirstFrameComesWithPixelsAndACamera) {
  const auto opened = source_->open();
  ASSERT_TRUE(opened) << opened.error().message;
  const auto frame = source_->next(kind().patience);
  ASSERT_TRUE(frame) << frame.error().message;
  ASSERT_TRUE(*frame);
  EXPECT_FALSE((*frame)->image.bytes.empty());
  EXPECT_FALSE((*frame)->name.empty());
  EXPECT_FALSE((*frame)->camera_id.empty());
  EXPECT_EQ((*frame)->camera.problem(), std::nullopt);
  EXPECT_GT((*frame)->time_ns, 0);
}

TEST_P(FrameSourceCompliance, TimesAndNumbersStrictlyIncrease) {
  ASSERT_TRUE(source_->open());
  std::map<std::string, std::int64_t> last_time;
  std::optional<std::uint64_t> last_number;
  for (int i = 0; i < kind().frames; ++i) {
    const auto frame = source_->next(kind().patience);
    ASSERT_TRUE(frame && *frame) << "frame " << i;
    const auto known = last_time.find((*frame)->camera_id);
    if (known != last_time.end()) {
      EXPECT_GT((*frame)->time_ns, known->second);
    }
    if (last_number) {
      EXPECT_GT((*frame)->sequence, *last_number);
    }
    last_time[(*frame)->camera_id] = (*frame)->time_ns;
    last_number = (*frame)->sequence;
    if ((*frame)->pose) {
      EXPECT_NEAR((*frame)->pose->ecef_from_camera.norm(), 1, 1e-9);
    }
  }
}

TEST_P(FrameSourceCompliance, FramesKeepTheSourcesPace) {
  ASSERT_TRUE(source_->open());
  ASSERT_TRUE(source_->next(kind().patience));
  const auto start = Clock::now();
  for (int i = 1; i < kind().frames; ++i) ASSERT_TRUE(source_->next(kind().patience));
  // Never faster than it was taken; how late a frame may be is the machine's matter.
  EXPECT_GE(Clock::now() - start, 0.8 * (kind().frames - 1) * kind().interval);
}

TEST_P(FrameSourceCompliance, AShortWaitEndsInTime) {
  ASSERT_TRUE(source_->open());
  const auto start = Clock::now();
  const auto frame = source_->next(std::chrono::milliseconds(1));
  if (!frame) {
    EXPECT_EQ(frame.error().code, ErrorCode::Unavailable);
  }
  EXPECT_LT(Clock::now() - start, std::chrono::seconds(2));
}

TEST_P(FrameSourceCompliance, StopEndsAWaitingCallWithinASecondAndNothingFollows) {
  ASSERT_TRUE(source_->open());
  ASSERT_TRUE(source_->next(kind().patience));
  Clock::time_point stopped;
  std::jthread stopper([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    stopped = Clock::now();
    source_->stop();
  });
  for (int i = 0; i < 1'000'000; ++i) {
    const auto frame = source_->next(std::chrono::seconds(20));
    if (frame && !*frame) break;
  }
  const auto ended = Clock::now();
  stopper.join();
  EXPECT_LT(ended - stopped, std::chrono::seconds(1));
  for (int i = 0; i < 3; ++i) {
    const auto frame = source_->next(std::chrono::milliseconds(50));
    ASSERT_TRUE(frame);
    EXPECT_EQ(*frame, nullptr);
  }
}

TEST_P(FrameSourceCompliance, AClosedSourceOpensAgain) {
  for (int round = 0; round < 3; ++round) {
    ASSERT_TRUE(source_->open()) << "round " << round;
    const auto frame = source_->next(kind().patience);
    ASSERT_TRUE(frame && *frame) << "round " << round;
    if (round != 1) source_->stop();  // with and without
    source_->close();
  }
}

TEST_P(FrameSourceCompliance, AnAbsentDeviceIsUnavailableAndSaysWhich) {
  const auto absent = kind().make_absent();
  for (int attempt = 0; attempt < 2; ++attempt) {
    const auto opened = absent->open();
    ASSERT_FALSE(opened);
    EXPECT_EQ(opened.error().code, ErrorCode::Unavailable);
    EXPECT_GT(opened.error().message.size(), 10u);
    absent->close();
  }
}

TEST_P(FrameSourceCompliance, FramesOutliveTheirSource) {
  ASSERT_TRUE(source_->open());
  const auto frame = source_->next(kind().patience);
  ASSERT_TRUE(frame && *frame);
  source_->close();
  source_.reset();
  std::size_t sum = 0;
  for (const std::uint8_t byte : (*frame)->image.bytes) sum += byte;
  EXPECT_GT(sum, 0u);
}

TEST_P(FrameSourceCompliance, DescribesItself) {
  EXPECT_NE(source_->describe().find(':'), std::string::npos);
}

}  // namespace overfly::capture
