#include "tiling/rectify/frame_cache.h"

#include <gtest/gtest.h>

#include "tests/unit/gl/gl_fixture.h"

namespace overfly::tiling {
namespace {

using Lru = PinnedLru<int>;

Lru::Ptr value(int v) { return std::make_shared<const int>(v); }

TEST(PinnedLru, LeastRecentlyUsedGoesFirst) {
  Lru lru(30);
  lru.insert(1, value(1), 10);
  lru.insert(2, value(2), 10);
  lru.insert(3, value(3), 10);
  ASSERT_NE(lru.find(1), nullptr);  // now 2 is the oldest
  lru.insert(4, value(4), 10);
  EXPECT_EQ(lru.find(2), nullptr);
  EXPECT_NE(lru.find(1), nullptr);
  EXPECT_NE(lru.find(3), nullptr);
  EXPECT_EQ(lru.bytes(), 30u);
  EXPECT_EQ(lru.evictions(), 1u);
}

TEST(PinnedLru, HeldValuesStayEvenOverTheBudget) {
  Lru lru(20);
  const auto held = value(1);
  lru.insert(1, held, 10);
  lru.insert(2, value(2), 10);
  lru.insert(3, value(3), 10);  // 1 is older but held: 2 goes
  EXPECT_EQ(lru.find(2), nullptr);
  EXPECT_EQ(lru.find(1), held);
  const auto also_held = lru.find(3);
  lru.insert(4, value(4), 10);
  EXPECT_EQ(lru.bytes(), 30u);  // nothing could go
  lru.insert(5, value(5), 10);
  EXPECT_EQ(lru.find(4), nullptr);
  EXPECT_EQ(lru.size(), 3u);
}

TEST(PinnedLru, ReplacingAKeyCountsItsBytesOnce) {
  Lru lru(100);
  lru.insert(1, value(1), 10);
  lru.insert(1, value(2), 25);
  EXPECT_EQ(lru.bytes(), 25u);
  EXPECT_EQ(*lru.find(1), 2);
}

class FrameCacheTest : public test::GlTest {
 protected:
  static capture::FramePtr frame(std::uint8_t grey) {
    auto out = std::make_shared<capture::Frame>();
    out->camera.width = out->camera.height = 64;
    out->camera.fx = out->camera.fy = 60;
    out->camera.cx = out->camera.cy = 32;
    out->image = {capture::PixelFormat::Grey8, 64, 64, 64, std::vector<std::uint8_t>(64 * 64, grey)};
    return out;
  }
  static constexpr std::size_t kFrameBytes = 64 * 64 * 4 + 5461;  // colour, and luma with its mips
};

TEST_F(FrameCacheTest, AFrameIsUploadedOnceWhileItStays) {
  auto rectifier = Rectifier::create(context());
  ASSERT_TRUE(rectifier.has_value());
  FrameCache cache(std::move(*rectifier), 3 * kFrameBytes);
  for (int round = 0; round < 2; ++round) {
    for (std::uint64_t id = 1; id <= 3; ++id) {
      const auto got = cache.acquire(id, frame(static_cast<std::uint8_t>(id * 51)));
      ASSERT_TRUE(got.has_value());
      EXPECT_NEAR((*got)->stats.mean, static_cast<double>(id) * 0.2, 1e-6);
    }
  }
  EXPECT_EQ(cache.stats().uploads, 3u);
  EXPECT_EQ(cache.stats().hits, 3u);
  EXPECT_EQ(cache.stats().bytes, 3 * kFrameBytes);
  EXPECT_GT(cache.stats().times.gpu_s, 0);
  ASSERT_TRUE(cache.acquire(4, frame(0)).has_value());
  EXPECT_EQ(cache.stats().evictions, 1u);
  EXPECT_EQ(cache.stats().frames, 3u);
}

TEST_F(FrameCacheTest, ANewCalibrationMakesTheFrameAnew) {
  auto rectifier = Rectifier::create(context());
  ASSERT_TRUE(rectifier.has_value());
  FrameCache cache(std::move(*rectifier), 10 * kFrameBytes);
  const auto before = frame(100);
  auto after = std::make_shared<capture::Frame>(*before);
  after->camera.fx = 61;
  ASSERT_TRUE(cache.acquire(1, before).has_value());
  const auto got = cache.acquire(1, after);
  ASSERT_TRUE(got.has_value());
  EXPECT_DOUBLE_EQ((*got)->pinhole.fx, 61);
  EXPECT_EQ(cache.stats().uploads, 2u);
  EXPECT_EQ(cache.stats().frames, 1u);
}

TEST_F(FrameCacheTest, ALoadersErrorIsHandedOnAndNothingIsKept) {
  auto rectifier = Rectifier::create(context());
  ASSERT_TRUE(rectifier.has_value());
  FrameCache cache(std::move(*rectifier), kFrameBytes);
  const auto got = cache.acquire(
      1, frame(0)->camera, []() -> Result<capture::FramePtr> { return fail(ErrorCode::Io, "disk gone"); });
  ASSERT_FALSE(got.has_value());
  EXPECT_EQ(got.error().code, ErrorCode::Io);
  EXPECT_EQ(cache.stats().frames, 0u);
  EXPECT_EQ(cache.stats().misses, 1u);
}

}  // namespace
}  // namespace overfly::tiling
