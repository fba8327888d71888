#include "capture/pose/clock_recovery.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace overfly::capture {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000, kMs = 1'000'000;
constexpr std::int64_t kHour = 3600 * kSecond;

// A device whose clock is off by `offset_ns` and fast by `drift`, asked once a second over a link with a
// round trip of `delay` and some jitter.
struct Device {
  std::int64_t offset_ns = 0;  // device minus ours, at our time 0
  double drift = 0;
  std::mt19937_64 random{3};

  std::int64_t at(std::int64_t boottime_ns) const {
    return boottime_ns + offset_ns + std::llround(drift * static_cast<double>(boottime_ns));
  }
  void ask(ClockRecovery& clock, std::int64_t boottime_ns) {
    const auto out = std::llround(std::gamma_distribution(2.0, 1e6)(random));
    const auto back = std::llround(std::gamma_distribution(2.0, 1e6)(random));
    const std::int64_t round_trip = out + back;
    clock.addPair(at(boottime_ns + out), boottime_ns + round_trip / 2,
                  std::llround(static_cast<double>(round_trip) / std::sqrt(12.0)));
  }
  void tell(ClockRecovery& clock, std::int64_t boottime_ns, std::int64_t extra_ns = 0) {
    const auto delay = 2 * kMs + std::llround(std::exponential_distribution(1.0 / 3e6)(random));
    clock.addArrival(at(boottime_ns), boottime_ns + delay + extra_ns);
  }
  // Our time minus what the clock says for the device's reading of it.
  std::int64_t error(const ClockRecovery& clock, std::int64_t boottime_ns) const {
    const auto time = clock.boottimeFrom(at(boottime_ns));
    return time ? time->ns - boottime_ns : kHour;
  }
};

TEST(ClockRecovery, OffsetAndDriftComeOutOfRoundTrips) {
  for (const double drift : {0.0, 40e-6, -100e-6}) {
    Device device{-7 * kHour + 123'456'789, drift};
    ClockRecovery clock;
    EXPECT_FALSE(clock.boottimeFrom(0));
    for (std::int64_t t = 5 * kSecond; t < 90 * kSecond; t += kSecond) device.ask(clock, t);
    const std::int64_t now = 90 * kSecond;
    EXPECT_LT(std::abs(device.error(clock, now)), kMs);
    EXPECT_NEAR(clock.drift(), drift, 20e-6);
    EXPECT_EQ(clock.counts().jumps, 0U);
    EXPECT_TRUE(clock.paired());
    const auto back = clock.deviceFrom(now);
    ASSERT_TRUE(back);
    EXPECT_NEAR(static_cast<double>(*back), static_cast<double>(device.at(now)), 1e6);
  }
}

// The stated uncertainty is honest: few errors beyond three sigma, and it grows when nothing is heard.
TEST(ClockRecovery, UncertaintyHoldsAndGrows) {
  int beyond = 0, all = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    Device device{kHour, 30e-6, std::mt19937_64(seed)};
    ClockRecovery clock;
    for (std::int64_t t = kSecond; t < 30 * kSecond; t += kSecond) device.ask(clock, t);
    const auto time = clock.boottimeFrom(device.at(30 * kSecond));
    ASSERT_TRUE(time);
    ++all;
    beyond += std::abs(time->ns - 30 * kSecond) > 3 * time->sigma_ns ? 1 : 0;
    const auto later = clock.boottimeFrom(device.at(330 * kSecond));
    EXPECT_GT(later->sigma_ns, 2 * time->sigma_ns);
    EXPECT_LT(std::abs(later->ns - 330 * kSecond), 4 * later->sigma_ns);
  }
  EXPECT_LE(beyond, 1) << "of " << all;
}

TEST(ClockRecovery, ArrivalsAloneAreWithinTheLinksSmallestDelay) {
  Device device{-3 * kHour, 20e-6};
  ClockRecovery clock;
  for (std::int64_t t = kSecond; t < 40 * kSecond; t += 20 * kMs) device.tell(clock, t);
  const std::int64_t error = device.error(clock, 40 * kSecond);
  EXPECT_GT(error, kMs);  // the smallest delay, which nobody can know
  EXPECT_LT(error, 4 * kMs);
  EXPECT_FALSE(clock.paired());
}

class ClockJump : public testing::TestWithParam<std::int64_t> {};

// Set back or forward by an hour, booted in 1970, a leap second: readings of the new time are followed after
// three round trips, and no single one is.
TEST_P(ClockJump, IsFollowedAfterThreeRoundTrips) {
  Device device{kHour * 24, 10e-6};
  ClockRecovery clock;
  std::int64_t t = kSecond;
  for (; t < 30 * kSecond; t += kSecond) device.ask(clock, t);
  const std::int64_t before = device.offset_ns;
  device.offset_ns += GetParam();
  device.ask(clock, t += kSecond);
  device.ask(clock, t += kSecond);
  device.offset_ns = before;
  EXPECT_LT(std::abs(device.error(clock, t)), 3 * kMs) << "two readings must not move it";
  device.offset_ns += GetParam();
  device.ask(clock, t += kSecond);
  EXPECT_EQ(clock.counts().jumps, 1U);
  EXPECT_LT(std::abs(device.error(clock, t)), 8 * kMs);
  for (int i = 0; i < 30; ++i) device.ask(clock, t += kSecond);
  EXPECT_LT(std::abs(device.error(clock, t)), 2 * kMs);
  EXPECT_EQ(clock.counts().jumps, 1U);
}

TEST_P(ClockJump, IsFollowedByArrivalsToo) {
  Device device{kHour * 24, 10e-6};
  ClockRecovery clock;
  std::int64_t t = kSecond;
  for (; t < 30 * kSecond; t += 20 * kMs) device.tell(clock, t);
  device.offset_ns += GetParam();
  for (const std::int64_t end = t + 8 * kSecond; t < end; t += 20 * kMs) device.tell(clock, t);
  EXPECT_EQ(clock.counts().jumps, 1U);
  EXPECT_LT(std::abs(device.error(clock, t)), 6 * kMs);
}

INSTANTIATE_TEST_SUITE_P(Sizes, ClockJump,
                         testing::Values(kHour, -kHour, kSecond, -kSecond, 56 * 365 * 24 * kHour,
                                         -24 * kHour));

TEST(ClockRecovery, SingleWildReadingsAreDropped) {
  Device device{0, 0};
  ClockRecovery clock;
  std::uniform_int_distribution<std::int64_t> wild(-kHour, kHour);
  for (std::int64_t t = kSecond; t < 200 * kSecond; t += kSecond) {
    device.ask(clock, t);
    if (t / kSecond % 5 == 0) clock.addPair(device.at(t) + wild(device.random), t, kMs);
  }
  EXPECT_LT(std::abs(device.error(clock, 200 * kSecond)), kMs);
  EXPECT_EQ(clock.counts().jumps, 0U);
  EXPECT_GT(clock.counts().outliers, 30U);
}

// A link that is congested for three seconds and delivers everything 400 ms late is no jump of the clock.
TEST(ClockRecovery, ACongestedLinkIsNoJump) {
  Device device{kHour, 0};
  ClockRecovery clock;
  for (std::int64_t t = kSecond; t < 60 * kSecond; t += 20 * kMs)
    device.tell(clock, t, t > 30 * kSecond && t < 33 * kSecond ? 400 * kMs : 0);
  EXPECT_EQ(clock.counts().jumps, 0U);
  EXPECT_LT(std::abs(device.error(clock, 60 * kSecond)), 4 * kMs);
}

// Any integers, as a hostile packet may hold them.
TEST(ClockRecovery, NoValueOverflows) {
  std::mt19937_64 random(1);
  ClockRecovery clock;
  const std::int64_t edges[] = {
      INT64_MIN, INT64_MAX, 0, -1, INT64_MAX / 2, INT64_MIN / 2, 4'000'000'000'000'000'000};
  for (int i = 0; i < 20'000; ++i) {
    const auto any = [&] {
      return random() % 3 == 0 ? edges[random() % 7] : static_cast<std::int64_t>(random());
    };
    if (random() % 2 == 0) {
      clock.addPair(any(), any(), any());
    } else {
      clock.addArrival(any(), any());
    }
    (void)clock.boottimeFrom(any());
    (void)clock.deviceFrom(any());
  }
  // And it still works.
  Device device{kHour, 0};
  for (std::int64_t t = kSecond; t < 20 * kSecond; t += kSecond) device.ask(clock, t);
  EXPECT_LT(std::abs(device.error(clock, 20 * kSecond)), 5 * kMs);
}

TEST(Unwrap32, MillisecondsGoOnBehind49Days) {
  const std::int64_t wrap = std::int64_t{1} << 32;
  EXPECT_EQ(unwrap32(5, wrap - 10), wrap + 5);
  EXPECT_EQ(unwrap32(4'294'967'290U, wrap + 3), wrap - 6);
  EXPECT_EQ(unwrap32(123, 3 * wrap + 100), 3 * wrap + 123);
  // A reboot: an hour lies nearer behind than 49 days before.
  EXPECT_EQ(unwrap32(500, 3'600'000), 500);
}

}  // namespace
}  // namespace overfly::capture
