#include "capture/gpio/pulse_matcher.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <map>
#include <random>
#include <vector>

namespace overfly::capture {
namespace {

constexpr std::int64_t kMs = 1'000'000, kSecond = 1000 * kMs;

// A camera that is released at times of some irregularity; each release gives a pulse and, later, a frame
// whose own stamp lags by `lag` and wanders by `jitter`.
struct Scene {
  std::int64_t interval_ns = 500 * kMs;
  double irregular = 0.1;  // share of the interval
  std::int64_t lag_ns = 40 * kMs;
  double jitter_ns = 1e6;
  double missed = 0, spurious = 0, dropped = 0;  // shares
  int frames = 200;
  int without = 0;           // frames before the first pulse
  std::int64_t late_ns = 0;  // frames are taken so much later: a machine that is too busy
};

struct Outcome {
  int right = 0, wrong = 0, none = 0;
  std::vector<std::int64_t> errors;  // ns, of right ones against the generator
  PulseMatcher matcher;
};

Outcome play(const Scene& scene, std::uint64_t seed, const PulseMatcherOptions& options = {}) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> normal(0, 1);
  struct Event {
    std::int64_t time_ns;
    bool is_frame;
    std::int64_t true_ns;  // of a frame: when it was released
    std::int64_t stamp_ns;
  };
  std::vector<Event> events;
  std::int64_t t = 100 * kSecond;
  for (int i = 0; i < scene.frames; ++i) {
    t +=
        std::llround(static_cast<double>(scene.interval_ns) * (1 + scene.irregular * (2 * unit(random) - 1)));
    const bool miss = unit(random) < scene.missed || i < scene.without;
    // The kernel's interrupt latency: a few microseconds, skewed.
    const auto latency = std::llround(std::exponential_distribution(1.0 / 3e3)(random));
    if (!miss) events.push_back({t + latency, false, t, 0});
    if (unit(random) < scene.spurious && i >= scene.without)
      events.push_back(
          {t + std::llround(unit(random) * static_cast<double>(scene.interval_ns)), false, -1, 0});
    const std::int64_t stamp = t + scene.lag_ns + std::llround(scene.jitter_ns * normal(random));
    // Who asks waits until pulses up to the frame's have been told.
    if (unit(random) >= scene.dropped)
      events.push_back({std::max(stamp, t + kMs) + scene.late_ns, true, t, stamp});
  }
  std::stable_sort(events.begin(), events.end(),
                   [](const Event& a, const Event& b) { return a.time_ns < b.time_ns; });
  Outcome outcome{0, 0, 0, {}, PulseMatcher(options)};
  std::int64_t last = 0;
  for (const Event& event : events) {
    if (!event.is_frame) {
      outcome.matcher.addPulse(event.time_ns);
      continue;
    }
    const auto match = outcome.matcher.match(event.stamp_ns);
    if (!match) {
      ++outcome.none;
      continue;
    }
    EXPECT_GT(match->pulse_ns, last) << "a pulse went back";
    last = match->pulse_ns;
    const std::int64_t error = match->pulse_ns - event.true_ns;
    if (std::abs(error) < 100'000) {
      ++outcome.right;
      outcome.errors.push_back(error);
    } else {
      ++outcome.wrong;
    }
  }
  return outcome;
}

std::int64_t quantile(std::vector<std::int64_t> values, double share) {
  for (std::int64_t& value : values) value = std::abs(value);
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

TEST(PulseMatcher, FramesGetTheirPulsesWithinMicroseconds) {
  const Outcome outcome = play({}, 1);
  EXPECT_EQ(outcome.wrong, 0);
  EXPECT_GE(outcome.right, 190);
  ASSERT_TRUE(outcome.matcher.lag());
  EXPECT_NEAR(static_cast<double>(outcome.matcher.lag()->ns), 40e6, 1e6);
  RecordProperty("median_ns", std::to_string(quantile(outcome.errors, 0.5)));
  RecordProperty("p99_ns", std::to_string(quantile(outcome.errors, 0.99)));
  EXPECT_LT(quantile(outcome.errors, 0.5), 5'000);
  EXPECT_LT(quantile(outcome.errors, 0.99), 50'000);
}

// The heart of it: a pulse too few or too many, or a frame that was dropped, concerns itself alone.
RC_GTEST_PROP(PulseMatcherProperty, NoFaultShiftsLaterFrames, ()) {
  Scene scene;
  scene.interval_ns = *rc::gen::inRange<std::int64_t>(100, 2000) * kMs;
  scene.irregular = *rc::gen::inRange(5, 30) * 0.01;
  scene.lag_ns = *rc::gen::inRange<std::int64_t>(-20, 200) * kMs;
  scene.jitter_ns = static_cast<double>(scene.interval_ns) * *rc::gen::inRange(1, 10) * 1e-3;
  scene.missed = *rc::gen::inRange(0, 20) * 0.01;
  scene.spurious = *rc::gen::inRange(0, 20) * 0.01;
  scene.dropped = *rc::gen::inRange(0, 20) * 0.01;
  const Outcome outcome = play(scene, *rc::gen::arbitrary<std::uint64_t>());
  // A spurious pulse where a missed one should have been cannot be told from it; nothing else may be wrong.
  const double by_chance = scene.missed * scene.spurious * 0.5 * scene.frames;
  RC_LOG() << "right " << outcome.right << " wrong " << outcome.wrong << " none " << outcome.none
           << std::endl;
  RC_ASSERT(outcome.wrong <= 2 + 3 * by_chance);
  RC_ASSERT(outcome.right > outcome.wrong * 10);
  RC_ASSERT(outcome.right + outcome.none > 100);
  RC_ASSERT(outcome.right > (1 - scene.missed) * (outcome.right + outcome.none) * 0.55);
}

// The lag changes in flight (another mode of the camera): it is found again, and nothing wrong is said
// before.
TEST(PulseMatcher, ANewLagIsFoundAgain) {
  PulseMatcher matcher;
  std::mt19937_64 random(3);
  std::int64_t t = kSecond, last_wrong = 0;
  int right = 0;
  for (int i = 0; i < 200; ++i) {
    t += 400 * kMs + static_cast<std::int64_t>(random() % 100) * kMs;
    const std::int64_t lag = i < 80 ? 30 * kMs : 95 * kMs;
    matcher.addPulse(t);
    const auto match = matcher.match(t + lag);
    if (match && match->pulse_ns != t) last_wrong = i;
    if (match && match->pulse_ns == t && i >= 80) ++right;
  }
  EXPECT_EQ(last_wrong, 0);
  EXPECT_GT(right, 95);
  EXPECT_EQ(matcher.counts().locks, 2U);
}

// Pulses and frames as regular as a clock, and a lag longer than the interval: only what is expected can
// tell.
TEST(PulseMatcher, ARegularPaceIsCalledAmbiguousAndFollowsWhatIsExpected) {
  Scene scene;
  scene.interval_ns = 33 * kMs;
  scene.irregular = 0;
  scene.jitter_ns = 2e5;
  scene.lag_ns = 40 * kMs;
  PulseMatcherOptions options;
  options.expected_lag_ns = 35 * kMs;
  const Outcome told = play(scene, 1, options);
  EXPECT_EQ(told.wrong, 0);
  EXPECT_GT(told.right, 170);  // those before it was sure have none
  ASSERT_TRUE(told.matcher.lag());
  EXPECT_TRUE(told.matcher.lag()->ambiguous);
  EXPECT_FALSE(play({}, 1).matcher.lag()->ambiguous);
}

// The same with stamps that wander by a twentieth of the interval, as where the machine is too busy to stamp
// frames in time, and pulses missing and too many: what fits better by chance is not taken for the truth.
TEST(PulseMatcher, WildStampsAtARegularPaceFollowWhatIsExpected) {
  int followed = 0, wrong = 0, right = 0;
  constexpr int kFlights = 60;
  for (std::uint64_t seed = 1; seed <= kFlights; ++seed) {
    Scene scene;
    scene.interval_ns = 500 * kMs;
    scene.irregular = 0.02;
    scene.jitter_ns = 30e6;
    scene.without = 20;
    scene.lag_ns = 30 * kMs;
    scene.missed = 0.05;
    scene.spurious = 0.07;
    PulseMatcherOptions options;
    options.expected_lag_ns = 30 * kMs;
    const Outcome outcome = play(scene, seed, options);
    const auto lag = outcome.matcher.lag();
    followed += lag && std::abs(lag->ns - scene.lag_ns) < 25 * kMs ? 1 : 0;
    wrong += outcome.wrong;
    right += outcome.right;
  }
  EXPECT_GE(followed, kFlights - 1);
  EXPECT_LT(wrong * 50, right);
}

// A line that speaks up only after the camera has run for a while: frames from before its first pulse do not
// pull the lag to where they would have one.
TEST(PulseMatcher, FramesFromBeforeTheFirstPulseSayNothingOfTheLag) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Scene scene;
    scene.interval_ns = 200 * kMs;
    scene.irregular = 0;
    scene.jitter_ns = 6e6;
    scene.without = 40;
    scene.missed = 0.05;
    scene.spurious = 0.05;
    scene.late_ns = 3 * kSecond;
    PulseMatcherOptions options;
    options.expected_lag_ns = 40 * kMs;
    const Outcome outcome = play(scene, seed, options);
    EXPECT_LE(outcome.wrong, 2) << seed;
    EXPECT_GE(outcome.right, 110) << seed;
  }
}

TEST(PulseMatcher, WithoutPulsesThereIsNoMatchAndNoHarm) {
  PulseMatcher matcher;
  for (int i = 0; i < 1000; ++i) EXPECT_FALSE(matcher.match(i * 100 * kMs));
  EXPECT_EQ(matcher.counts().frames_without, 1000U);
}

}  // namespace
}  // namespace overfly::capture
