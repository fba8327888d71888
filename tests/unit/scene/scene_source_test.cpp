#include "render/scene/scene_source.h"

#include <gtest/gtest.h>

#include <thread>

#include "tests/unit/scene/scene_fixture.h"

namespace overfly::scene {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

const std::string kFlight =
    "[terrain]\nextent = [100, 100]\n[path]\nframes = 6\nlines = 2\nheight = 40\n[camera]\nwidth = "
    "160\nheight = 120\nfx = 120\n";

capture::FramePtr take(SceneSource& source) {
  for (int i = 0; i < 100; ++i) {
    Result<capture::FramePtr> frame = source.next(milliseconds(500));
    if (frame) return *frame;
    if (frame.error().code != ErrorCode::Unavailable) throw std::runtime_error(frame.error().message);
  }
  throw std::runtime_error("no frame");
}

TEST(SceneSource, YieldsEveryFrameInOrderWithExactPoses) {
  SceneSource source(worldOf(kFlight), {.speed = 0});
  for (int round = 0; round < 2; ++round) {  // a closed source opens again
    ASSERT_TRUE(source.open());
    std::int64_t last = 0;
    for (std::uint64_t i = 0; i < 6; ++i) {
      const capture::FramePtr frame = take(source);
      ASSERT_TRUE(frame);
      EXPECT_EQ(frame->sequence, i);
      EXPECT_GT(frame->time_ns, last);
      last = frame->time_ns;
      EXPECT_TRUE(frame->pose_is_adjusted);
      ASSERT_TRUE(frame->pose);
      EXPECT_EQ(frame->pose->time_ns, frame->time_ns);
      const geo::Geodetic place = geo::geodeticFromEcef(frame->pose->position_in_ecef);
      EXPECT_NEAR(place.height_m, 540, 0.01);
      EXPECT_EQ(frame->datum, capture::VerticalDatum::Ellipsoid);
      EXPECT_EQ(frame->image.bytes.size(), 160u * 120u * 3u);
    }
    EXPECT_FALSE(take(source));  // the end
    source.close();
  }
}

TEST(SceneSource, KeepsTrueSpeed) {
  SceneSource source(worldOf(kFlight), {.speed = 4});
  ASSERT_TRUE(source.open());
  const auto start = Clock::now();
  const FlightPath path(source.world()->description.path, source.world()->description.camera, 1);
  for (int i = 0; i < 3; ++i) take(source);
  EXPECT_GE(std::chrono::duration<double>(Clock::now() - start).count(), path.timeOf(2) / 4 - 0.01);
}

TEST(SceneSource, StopEndsAWaitingNext) {
  SceneSource source(worldOf(kFlight), {.speed = 0.01});
  ASSERT_TRUE(source.open());
  take(source);
  std::jthread stopper([&] {
    std::this_thread::sleep_for(milliseconds(100));
    source.stop();
  });
  const auto start = Clock::now();
  const Result<capture::FramePtr> frame = source.next(milliseconds(30000));
  EXPECT_LT(std::chrono::duration<double>(Clock::now() - start).count(), 1.1);
  ASSERT_TRUE(frame);
  EXPECT_FALSE(*frame);
  EXPECT_FALSE(*source.next(milliseconds(10)));
}

TEST(SceneSource, AnAbsentSceneIsUnavailable) {
  SceneSource source("/nowhere/at/all.toml");
  const Result<void> opened = source.open();
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().code, ErrorCode::Unavailable);
}

TEST(SceneSource, JpegIsAnEffect) {
  SceneSource source(worldOf("effects = [\"jpeg\"]\n" + kFlight), {.speed = 0});
  ASSERT_TRUE(source.open());
  const capture::FramePtr frame = take(source);
  EXPECT_EQ(frame->image.format, capture::PixelFormat::Jpeg);
  ASSERT_GT(frame->image.bytes.size(), 100u);
  EXPECT_EQ(frame->image.bytes[0], 0xff);
  EXPECT_EQ(frame->image.bytes[1], 0xd8);
}

}  // namespace
}  // namespace overfly::scene
