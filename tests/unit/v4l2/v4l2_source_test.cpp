#include "capture/v4l2/v4l2_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "tests/unit/v4l2/fake_kernel.h"

namespace overfly::capture {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;

class V4l2 : public testing::Test {
 protected:
  V4l2() {
    options_.device = "/dev/video0";
    options_.lens.width = 64;
    options_.lens.height = 48;
    options_.lens.fx = options_.lens.fy = 60;
    options_.lens.cx = 32;
    options_.lens.cy = 24;
  }
  V4l2Source& source() {
    if (!source_) source_ = std::make_unique<V4l2Source>(options_, kernel_);
    return *source_;
  }
  std::string problemOfOpen(ErrorCode code) {
    const auto opened = source().open();
    if (opened) return "opened";
    EXPECT_EQ(opened.error().code, code);
    EXPECT_EQ(source().status().problem, opened.error().message);
    EXPECT_EQ(kernel_->opened, 0);
    return opened.error().message;
  }
  FramePtr frame() {
    const auto next = source().next(5s);
    EXPECT_TRUE(next) << (next ? "" : next.error().message);
    return next ? *next : nullptr;
  }

  LiveCameraOptions options_;
  std::shared_ptr<v4l2::FakeKernel> kernel_ = std::make_shared<v4l2::FakeKernel>();
  std::unique_ptr<V4l2Source> source_;
};

// --- what a person is told
// -------------------------------------------------------------------------------------

TEST_F(V4l2, AnAbsentCameraIsNamedWithWhatToDo) {
  kernel_->plug(false);
  EXPECT_THAT(problemOfOpen(ErrorCode::Unavailable),
              AllOf(HasSubstr("/dev/video0"), HasSubstr("source.path")));
}

TEST_F(V4l2, AForbiddenCameraSaysWhichGroupMayOpenIt) {
  kernel_->open_error = EACCES;
  // The node itself is not here: the group that Debian gives cameras is named.
  EXPECT_THAT(problemOfOpen(ErrorCode::Io), AllOf(HasSubstr("group video"), HasSubstr("usermod -aG video")));
}

TEST_F(V4l2, ACameraInUseSaysHowToFindTheOther) {
  for (const unsigned long call : {VIDIOC_S_FMT, VIDIOC_REQBUFS, VIDIOC_STREAMON}) {
    kernel_->errors = {{call, EBUSY}};
    EXPECT_THAT(problemOfOpen(ErrorCode::Unavailable), HasSubstr("fuser -v /dev/video0"));
  }
  kernel_->errors.clear();
  EXPECT_TRUE(source().open());
}

TEST_F(V4l2, AWrongFormatListsTheOnesThatThereAre) {
  options_.format = LiveCameraOptions::Format::Nv12;
  EXPECT_THAT(
      problemOfOpen(ErrorCode::Unsupported),
      AllOf(HasSubstr("does not give nv12"), HasSubstr("grey 64x48, 32x24"), HasSubstr("camera.format")));
}

TEST_F(V4l2, AWrongSizeListsTheOnesThatThereAre) {
  options_.width = 4000;
  options_.height = 3000;
  EXPECT_THAT(problemOfOpen(ErrorCode::Unsupported),
              AllOf(HasSubstr("at 4000x3000"), HasSubstr("grey 64x48, 32x24")));
}

// One object, opened again and again as the daemon does: each trouble counts once, however often it is met,
// and the camera goes on when it is put right.
TEST_F(V4l2, EachTroubleIsCountedOnceAndGoneOnFrom) {
  const auto formats = kernel_->formats;
  const auto meet = [&](ErrorCode code) {
    for (int i = 0; i < 3; ++i) problemOfOpen(code);
  };
  kernel_->plug(false);
  meet(ErrorCode::Unavailable);
  kernel_->plug(true);
  kernel_->open_error = EACCES;
  meet(ErrorCode::Io);
  kernel_->open_error = 0;
  kernel_->formats = {{V4L2_PIX_FMT_HEVC, {{64, 48}}}};
  meet(ErrorCode::Unsupported);
  kernel_->formats = formats;
  ASSERT_TRUE(source().open());
  EXPECT_TRUE(frame());
  EXPECT_EQ(source().status().problem, "");
  EXPECT_EQ(source().status().errors, (std::map<std::string, std::uint64_t>{
                                          {"not there", 1}, {"refused", 1}, {"unsuitable", 1}}));
}

TEST_F(V4l2, ALensOfAnotherShapeIsRefused) {
  options_.lens.height = 64;
  EXPECT_THAT(problemOfOpen(ErrorCode::Unsupported),
              AllOf(HasSubstr("64x64"), HasSubstr("64x48"), HasSubstr("camera.model_file")));
}

TEST_F(V4l2, ANodeThatTakesNoPicturesIsTold) {
  kernel_->capabilities = V4L2_CAP_META_CAPTURE | V4L2_CAP_STREAMING;
  EXPECT_THAT(problemOfOpen(ErrorCode::Unsupported), HasSubstr("takes no pictures"));
  kernel_->errors = {{VIDIOC_QUERYCAP, ENOTTY}};
  EXPECT_THAT(problemOfOpen(ErrorCode::Unsupported), HasSubstr("not a video device"));
}

TEST_F(V4l2, NoSignalIsSaid) {
  kernel_->errors = {{VIDIOC_STREAMON, ENOLINK}};
  EXPECT_THAT(problemOfOpen(ErrorCode::Unavailable), HasSubstr("no signal"));
}

TEST_F(V4l2, WithoutAPathTheFirstCameraIsTaken) {
  options_.device.clear();
  ASSERT_TRUE(source().open());
  EXPECT_TRUE(frame());
  source().close();
  kernel_->plug(false);
  EXPECT_THAT(problemOfOpen(ErrorCode::Unavailable), HasSubstr("no camera below /dev/video*"));
}

// --- frames
// ----------------------------------------------------------------------------------------------------

TEST_F(V4l2, TheLargestSizeIsTakenAndTheLensScaledToIt) {
  options_.lens = options_.lens.scaled(2);
  options_.lens.width = 128;
  options_.lens.height = 96;
  ASSERT_TRUE(source().open());
  const FramePtr first = frame();
  ASSERT_TRUE(first);
  EXPECT_EQ(first->image.width, 64);
  EXPECT_EQ(first->image.stride, 64) << "the driver's padding is left behind";
  EXPECT_NEAR(first->camera.fx, 60, 1e-9);
  EXPECT_EQ(first->camera.problem(), std::nullopt);
}

TEST_F(V4l2, FramesThatTheDriverCountedAndDidNotGiveAreDropped) {
  ASSERT_TRUE(source().open());
  const FramePtr first = frame();
  kernel_->drop(3);
  const FramePtr second = frame();
  ASSERT_TRUE(first && second);
  EXPECT_EQ(second->sequence, first->sequence + 4);
  EXPECT_EQ(source().status().dropped, 3u);
}

TEST_F(V4l2, NumbersOutliveTheDriversOverflow) {
  kernel_->first_sequence = 0xFFFFFFFE;
  ASSERT_TRUE(source().open());
  std::uint64_t last = frame()->sequence;
  for (int i = 0; i < 5; ++i) {
    const std::uint64_t next = frame()->sequence;
    EXPECT_EQ(next, last + 1);
    last = next;
  }
  EXPECT_EQ(source().status().dropped, 0u);
}

TEST_F(V4l2, ADamagedPictureIsCountedAndTheNextOneIsGood) {
  ASSERT_TRUE(source().open());
  ASSERT_TRUE(frame());
  kernel_->damageNext();
  const auto damaged = source().next(5s);
  ASSERT_FALSE(damaged);
  EXPECT_EQ(damaged.error().code, ErrorCode::BadInput);
  EXPECT_TRUE(frame());
  EXPECT_EQ(source().status().errors.at("damaged"), 1u);
}

std::int64_t nowOf(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

TEST_F(V4l2, TimesAreTheMiddleOfTheMiddleRowsExposure) {
  options_.exposure_ns = 8'000'000;
  options_.rolling_shutter_ns = 20'000'000;
  kernel_->control_ranges = {{V4L2_CID_EXPOSURE_AUTO, {0, 3}}, {V4L2_CID_EXPOSURE_ABSOLUTE, {1, 1000}}};
  // The fake stamps on the steady clock, which is CLOCK_MONOTONIC; a frame is given when it is due.
  for (const bool at_start : {false, true}) {
    kernel_->at_start = at_start;
    ASSERT_TRUE(source().open());
    const FramePtr taken = frame();
    ASSERT_TRUE(taken);
    EXPECT_EQ(taken->exposure_ns, 8'000'000);
    const std::int64_t age_ns = nowOf(CLOCK_BOOTTIME) - taken->time_ns;
    if (at_start) {
      EXPECT_LT(age_ns, 5'000'000'000);
      EXPECT_GE(age_ns, -14'000'000);  // the middle is yet to come
    } else {
      EXPECT_GE(age_ns, 14'000'000);
      EXPECT_LT(age_ns, 5'014'000'000);
    }
    source().close();
    // Both kinds of stamp in one run: the start's times lie 28 ms later and still increase.
  }
}

TEST_F(V4l2, ADriverWithoutStampsGivesWiderTimes) {
  ASSERT_TRUE(source().open());
  const std::int64_t stamped = frame()->time_sigma_ns;
  source().close();
  kernel_->stamps = false;
  ASSERT_TRUE(source().open());
  const FramePtr taken = frame();
  EXPECT_GT(taken->time_sigma_ns, stamped);
  EXPECT_LT(std::abs(nowOf(CLOCK_BOOTTIME) - taken->time_ns), 5'000'000'000);
}

// --- controls
// --------------------------------------------------------------------------------------------------

TEST_F(V4l2, ControlsAreSetWithinTheirRangeAndMissingOnesCounted) {
  options_.exposure_ns = 500'000'000;
  options_.gain = 4;
  kernel_->control_ranges = {{V4L2_CID_EXPOSURE_AUTO, {0, 3}},
                             {V4L2_CID_EXPOSURE_ABSOLUTE, {1, 1000}},
                             {V4L2_CID_FOCUS_AUTO, {0, 1}},
                             {V4L2_CID_FOCUS_ABSOLUTE, {5, 250}}};
  ASSERT_TRUE(source().open());
  EXPECT_EQ(kernel_->controls.at(V4L2_CID_EXPOSURE_AUTO), V4L2_EXPOSURE_MANUAL);
  EXPECT_EQ(kernel_->controls.at(V4L2_CID_EXPOSURE_ABSOLUTE), 1000);
  EXPECT_EQ(frame()->exposure_ns, 100'000'000);
  EXPECT_EQ(kernel_->controls.at(V4L2_CID_FOCUS_AUTO), 0);
  EXPECT_EQ(kernel_->controls.at(V4L2_CID_FOCUS_ABSOLUTE), 5);
  EXPECT_EQ(source().status().errors.at("no gain control"), 1u);
}

// --- a cable that comes out
// ------------------------------------------------------------------------------------

TEST_F(V4l2, APulledCameraGoesOnByItselfTwentyTimes) {
  ASSERT_TRUE(source().open());
  std::uint64_t last = frame()->sequence;
  for (std::uint64_t round = 1; round <= 20; ++round) {
    kernel_->plug(false);
    // What was filled before is not read any more.
    const auto away = source().next(20ms);
    ASSERT_FALSE(away);
    EXPECT_EQ(away.error().code, ErrorCode::Unavailable);
    EXPECT_THAT(away.error().message, HasSubstr("no camera at /dev/video0"));
    EXPECT_FALSE(source().status().present);
    EXPECT_EQ(kernel_->opened, 0) << "a node that is held keeps its number from the camera that comes back";
    EXPECT_EQ(kernel_->mapped, 0);
    kernel_->plug(true);
    const FramePtr next = frame();
    ASSERT_TRUE(next);
    EXPECT_GT(next->sequence, last + 1) << "what was missed is at least one frame";
    last = next->sequence;
    EXPECT_TRUE(source().status().present);
    EXPECT_EQ(source().status().reconnects, round);
  }
  EXPECT_EQ(source().status().errors.at("unplugged"), 20u);
}

TEST_F(V4l2, ACameraMayComeBackWithoutItsPermissionsYet) {
  ASSERT_TRUE(source().open());
  ASSERT_TRUE(frame());
  kernel_->plug(false);
  EXPECT_FALSE(source().next(20ms));
  kernel_->open_error = EACCES;  // udev has not given it to its group yet
  kernel_->plug(true);
  const auto forbidden = source().next(500ms);
  ASSERT_FALSE(forbidden);
  EXPECT_THAT(forbidden.error().message, HasSubstr("group"));
  kernel_->open_error = 0;
  EXPECT_TRUE(frame());
}

TEST_F(V4l2, StopEndsTheWaitForACameraThatIsAway) {
  ASSERT_TRUE(source().open());
  kernel_->plug(false);
  EXPECT_FALSE(source().next(10ms));
  std::jthread stopper([&] {
    std::this_thread::sleep_for(30ms);
    source().stop();
  });
  const auto start = std::chrono::steady_clock::now();
  const auto ended = source().next(60s);
  EXPECT_LT(std::chrono::steady_clock::now() - start, 10s);
  ASSERT_TRUE(ended);
  EXPECT_EQ(*ended, nullptr);
}

}  // namespace
}  // namespace overfly::capture
