#include "capture/gpio/gpio_stamps.h"

#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <thread>

namespace overfly::capture {
namespace {

using namespace std::chrono_literals;
constexpr std::int64_t kMs = 1'000'000;

// Edges as a real line gave them, told one wait at a time; then an error or silence.
class PlayedEdges final : public EdgeLines {
 public:
  explicit PlayedEdges(std::vector<std::vector<GpioEdge>> batches, bool goes)
      : batches_(std::move(batches)), goes_(goes) {}
  Result<std::vector<GpioEdge>> wait(std::chrono::milliseconds timeout) override {
    if (next_ < batches_.size()) return batches_[next_++];
    if (goes_) return fail(ErrorCode::Unavailable, "/dev/gpiochip9 is gone: No such device");
    std::this_thread::sleep_for(std::min(timeout, 5ms));
    return std::vector<GpioEdge>{};
  }

 private:
  std::vector<std::vector<GpioEdge>> batches_;
  std::size_t next_ = 0;
  bool goes_;
};

GpioEdge edge(std::uint32_t line, std::int64_t time_ns) { return {time_ns, line, true, 0, time_ns}; }

template <class Condition>
bool eventually(Condition&& condition) {
  for (int i = 0; i < 2000; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(5ms);
  }
  return false;
}

TEST(Debouncer, BouncingIsDroppedAndTheFirstEdgeStays) {
  Debouncer debouncer(200'000);
  int accepted = 0;
  for (std::int64_t pulse = 1; pulse <= 100; ++pulse) {
    const std::int64_t t = pulse * 100 * kMs;
    EXPECT_TRUE(debouncer.accept(edge(3, t)));
    for (const std::int64_t bounce : {20'000, 45'000, 130'000})
      accepted += debouncer.accept(edge(3, t + bounce)) ? 1 : 0;
    EXPECT_TRUE(debouncer.accept(edge(4, t + 50'000))) << "another line is another line";
  }
  EXPECT_EQ(accepted, 0);
}

TEST(GpioStamps, EdgesGoWhereTheyBelong) {
  GpioStampsOptions options;
  options.chip = "gpiochip9";
  options.exposure = {5, true};
  options.pps = {7, true};
  std::atomic<int> raw{0}, exposures{0}, pps{0};
  std::atomic<std::int64_t> quiet{0};
  GpioStamps stamps(options,
                    {[&](const RawInput&) { ++raw; }, [&](std::int64_t) { ++exposures; },
                     [&](std::int64_t) { ++pps; }, [&](std::int64_t until) { quiet = until; }},
                    [](const std::vector<LineWanted>& lines) -> Result<std::unique_ptr<EdgeLines>> {
                      EXPECT_EQ(lines.size(), 2U);
                      return std::make_unique<PlayedEdges>(
                          std::vector<std::vector<GpioEdge>>{
                              {edge(5, 1000 * kMs), edge(5, 1000 * kMs + 30'000), edge(7, 1001 * kMs)},
                              {edge(5, 1500 * kMs)}},
                          false);
                    });
  stamps.start();
  EXPECT_TRUE(eventually([&] { return exposures == 2 && pps == 1 && quiet > 0; }));
  EXPECT_TRUE(eventually([&] { return raw == 4; }));
  const GpioStatus status = stamps.status();
  EXPECT_TRUE(status.open);
  EXPECT_EQ(status.bounced, 1U);
  EXPECT_EQ(status.problem, "");
}

TEST(GpioStamps, APulseIsToldBeforeItIsRecorded) {
  GpioStampsOptions options;
  options.exposure = {5, true};
  std::atomic<int> exposures{0}, told_before{-1};
  GpioStamps stamps(
      options,
      {[&](const RawInput&) { told_before = exposures.load(); }, [&](std::int64_t) { ++exposures; }, {}, {}},
      [](const std::vector<LineWanted>&) -> Result<std::unique_ptr<EdgeLines>> {
        return std::make_unique<PlayedEdges>(std::vector<std::vector<GpioEdge>>{{edge(5, 1000 * kMs)}},
                                             false);
      });
  stamps.start();
  EXPECT_TRUE(eventually([&] { return told_before >= 0; }));
  EXPECT_EQ(told_before, 1);
}

// A line that somebody else has, a chip that is unplugged: said, counted, and gone on when it is free or
// back.
TEST(GpioStamps, ComesBackByItself) {
  GpioStampsOptions options;
  options.chip = "gpiochip9";
  options.exposure = {5, true};
  options.retry = 10ms;
  std::atomic<int> opened{0}, exposures{0};
  GpioStamps stamps(options, {{}, [&](std::int64_t) { ++exposures; }, {}, {}},
                    [&](const std::vector<LineWanted>&) -> Result<std::unique_ptr<EdgeLines>> {
                      const int time = opened++;
                      if (time < 3)
                        return fail(ErrorCode::Io, "/dev/gpiochip9: line 5 is in use by \"camera\"");
                      return std::make_unique<PlayedEdges>(
                          std::vector<std::vector<GpioEdge>>{{edge(5, time * 1000 * kMs)}}, time == 3);
                    });
  stamps.start();
  EXPECT_TRUE(eventually([&] { return exposures == 2; }));
  EXPECT_TRUE(eventually([&] { return stamps.status().reopened == 1; }));
  EXPECT_EQ(stamps.status().problem, "");
  EXPECT_EQ(stamps.status().problems, 2U) << "in use, which is said three times, and gone";
}

TEST(GpioLines, WhatIsWrongIsSaid) {
  const auto absent = EdgeLines::open("gpiochip4711", {{0, true}});
  ASSERT_FALSE(absent);
  if (std::string(gpioLibrary()) == "none") GTEST_SKIP() << "built without libgpiod";
  EXPECT_EQ(absent.error().code, ErrorCode::Unavailable);
  EXPECT_NE(absent.error().message.find("/dev/gpiochip4711: no such GPIO chip"), std::string::npos)
      << absent.error().message;
  const auto other = EdgeLines::open("/dev/null", {{0, true}});
  ASSERT_FALSE(other);
  EXPECT_NE(other.error().message.find("not a GPIO chip"), std::string::npos) << other.error().message;
  EXPECT_FALSE(OutputLine::open("gpiochip4711", 0));
}

class CountedLine final : public OutputLine {
 public:
  explicit CountedLine(std::atomic<int>& rises) : rises_(rises) {}
  Result<void> set(bool high) override {
    if (high) ++rises_;
    return {};
  }

 private:
  std::atomic<int>& rises_;
};

// Lateness does not add up: after a while the pulses are as many as the time holds.
TEST(TriggerOutput, PulsesComeAtTheSetPace) {
  TriggerOptions options;
  options.interval = 20ms;
  options.width = 1ms;
  std::atomic<int> rises{0};
  TriggerOutput trigger(
      options, [&]() -> Result<std::unique_ptr<OutputLine>> { return std::make_unique<CountedLine>(rises); });
  trigger.start();
  EXPECT_TRUE(eventually([&] { return rises >= 10; }));
  trigger.stop();
  const int at_stop = rises;
  std::this_thread::sleep_for(60ms);
  EXPECT_EQ(rises, at_stop);
  EXPECT_GE(trigger.status().pulses, 9U);
}

}  // namespace
}  // namespace overfly::capture
