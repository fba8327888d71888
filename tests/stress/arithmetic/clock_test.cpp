#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>

#include "capture/pose/clock_recovery.h"
#include "tests/stress/hard_case/hard_case.h"

// The autopilot's clock that jumps, wraps, or tells its times out of order.
namespace overfly::capture {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000, kMs = 1'000'000;
constexpr std::int64_t kHour = 3600 * kSecond, kYear = 365 * 24 * kHour;

// Asked once a second over a link whose two ways take 2 ms each in the mean.
struct Device {
  std::int64_t offset_ns = 24 * kHour;
  std::mt19937_64 random{5};

  std::int64_t at(std::int64_t t) const { return t + offset_ns; }
  void ask(ClockRecovery& clock, std::int64_t t) {
    std::gamma_distribution way(2.0, 1e6);
    const auto out = std::llround(way(random)), back = std::llround(way(random));
    clock.addPair(at(t + out), t + (out + back) / 2,
                  std::llround(static_cast<double>(out + back) / std::sqrt(12.0)));
  }
  double errorMs(const ClockRecovery& clock, std::int64_t t) const {
    const auto time = clock.boottimeFrom(at(t));
    return time ? std::abs(static_cast<double>(time->ns - t)) / static_cast<double>(kMs) : 1e9;
  }
};

TEST(Clock, JumpsAreFollowed) {
  double at_once_ms = 0, settled_ms = 0;
  for (const std::int64_t jump : {kHour, -kHour, 10 * kYear, -10 * kYear, 56 * kYear /* booted in 1970 */,
                                  kSecond, -kSecond /* leap */}) {
    Device device;
    ClockRecovery clock;
    std::int64_t t = kSecond;
    for (; t < 30 * kSecond; t += kSecond) device.ask(clock, t);
    device.offset_ns += jump;
    for (int i = 0; i < 3; ++i) device.ask(clock, t += kSecond);
    at_once_ms = std::max(at_once_ms, device.errorMs(clock, t));
    for (int i = 0; i < 30; ++i) device.ask(clock, t += kSecond);
    settled_ms = std::max(settled_ms, device.errorMs(clock, t));
    EXPECT_EQ(clock.counts().jumps, 1U);
  }
  test::expectAtMost("clock/jump", "ms off after three round trips, the worst of seven jumps", at_once_ms, 8);
  test::expectAtMost("clock/jump", "ms off half a minute later", settled_ms, 2);
}

TEST(Clock, TimesOutOfOrderAreNoJump) {
  Device device;
  ClockRecovery clock;
  for (std::int64_t t = 2 * kSecond; t < 60 * kSecond; t += 2 * kSecond) {
    device.ask(clock, t + kSecond);
    device.ask(clock, t);
  }
  EXPECT_EQ(clock.counts().jumps, 0U);
  test::expectAtMost("clock/order", "ms off, every two round trips the wrong way round",
                     device.errorMs(clock, 60 * kSecond), 2);
}

TEST(Clock, AWrappingCounterGoesOn) {
  double mistaken = 0;
  std::mt19937_64 random(7);
  std::uniform_int_distribution<std::int64_t> time(0, std::int64_t{20} << 32);
  std::uniform_int_distribution<std::int64_t> gap(-60'000, 60'000);
  for (int i = 0; i < 100'000; ++i) {
    const std::int64_t near = time(random), now = std::max<std::int64_t>(0, near + gap(random));
    mistaken += unwrap32(static_cast<std::uint32_t>(now), near) == now ? 0 : 1;
  }
  for (std::int64_t wrap = 1; wrap <= 20; ++wrap)
    for (std::int64_t step = -1000; step <= 1000; ++step) {
      const std::int64_t now = (wrap << 32) + step;
      mistaken += unwrap32(static_cast<std::uint32_t>(now), now - 40) == now ? 0 : 1;
    }
  test::expectAtMost("clock/wrap", "milliseconds read wrongly over 20 wraps of 32 bits", mistaken, 0);
}

}  // namespace
}  // namespace overfly::capture
