#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/integration/daemon/daemon_process.h"
#include "tests/integration/link/client.h"
#include "tests/stress/hard_case/hard_case.h"

// A flight that goes round and round, for OVERFLY_SOAK_S seconds.
namespace overfly::test {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

struct Sample {
  double time_s = 0;
  double rss_mb = 0, descriptors = 0, threads = 0;
  double answer_ms = 0;  // of the link, to a client that asks what tiles there are
  double frames = 0;
};

double numberBehind(const std::string& file, const std::string& name) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);)
    if (line.starts_with(name)) return std::atof(line.c_str() + name.size());
  return 0;
}

// Least squares, per second.
double slope(const std::vector<Sample>& samples, double Sample::*value) {
  double t = 0, v = 0, tt = 0, tv = 0;
  const auto n = static_cast<double>(samples.size());
  for (const Sample& s : samples) {
    t += s.time_s;
    v += s.*value;
  }
  for (const Sample& s : samples) {
    tt += (s.time_s - t / n) * (s.time_s - t / n);
    tv += (s.time_s - t / n) * (s.*value - v / n);
  }
  return tv / tt;
}

double median(std::vector<Sample>::const_iterator from, std::vector<Sample>::const_iterator to,
              double Sample::*value) {
  std::vector<double> values;
  for (; from != to; ++from) values.push_back((*from).*value);
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

TEST(Soak, ALoopedFlight) {
  if (smokeFlight().empty()) GTEST_SKIP() << "the flight brighton-beach-smoke is not here";
  const char* asked = std::getenv("OVERFLY_SOAK_S");
  const double length_s = asked != nullptr ? std::atof(asked) : 180;
  DaemonProcess daemon(16);
  // Caches so small that the first minute fills them.
  daemon.start({"--set", "source.loop=true", "--set", "gpu.frame_cache_mb=64", "--set", "clipmap.ram_mb=16"});
  ASSERT_TRUE(daemon.waitFor([](const auto& s) { return s["tiles"]["written"] > 0; }, 120s)) << daemon.log();
  const std::string proc = fmt::format("/proc/{}/", daemon.pid());
  std::vector<Sample> samples;
  const auto start = Clock::now();
  while (std::chrono::duration<double>(Clock::now() - start).count() < length_s) {
    Sample sample;
    const auto asking = Clock::now();
    ASSERT_EQ(fetch(daemon.url() + "/tiles.json").status, 200);
    sample.answer_ms = std::chrono::duration<double, std::milli>(Clock::now() - asking).count();
    sample.time_s = std::chrono::duration<double>(Clock::now() - start).count();
    sample.rss_mb = numberBehind(proc + "status", "VmRSS:") / 1024;
    sample.threads = numberBehind(proc + "status", "Threads:");
    sample.descriptors = static_cast<double>(std::distance(std::filesystem::directory_iterator(proc + "fd"),
                                                           std::filesystem::directory_iterator{}));
    sample.frames = daemon.status()["frames"]["mapped"];
    samples.push_back(sample);
    std::this_thread::sleep_for(1s);
  }
  ASSERT_GE(samples.size(), 20u);
  // The first half fills the caches, and makes the shaders for every number of views.
  const auto warm = samples.cbegin() + static_cast<std::ptrdiff_t>(samples.size() / 2);
  const std::vector<Sample> steady(warm, samples.cend());
  const auto middle = steady.cbegin() + static_cast<std::ptrdiff_t>(steady.size() / 2);
  for (std::size_t i = 0; i < samples.size(); i += std::max<std::size_t>(1, samples.size() / 12))
    std::printf("%6.0f s: %6.0f frames, %.2f MB, %.0f descriptors, %.0f threads, %.1f ms\n",
                samples[i].time_s, samples[i].frames, samples[i].rss_mb, samples[i].descriptors,
                samples[i].threads, samples[i].answer_ms);
  const double frames = samples.back().frames - steady.front().frames;
  std::printf("%.0f s, %.0f frames after the warm-up: RSS %+.2f MB an hour, %+.2f kB a frame\n", length_s,
              frames, 3600 * slope(steady, &Sample::rss_mb),
              1024 * slope(steady, &Sample::rss_mb) / std::max(1e-9, slope(steady, &Sample::frames)));
  EXPECT_GT(frames, 18);
  expectAtMost("soak/memory", "slope of the memory after the warm-up, kB a frame",
               1024 * slope(steady, &Sample::rss_mb) / std::max(1e-9, slope(steady, &Sample::frames)), 32);
  const auto [least, most] =
      std::minmax_element(steady.begin(), steady.end(),
                          [](const auto& a, const auto& b) { return a.descriptors < b.descriptors; });
  expectAtMost("soak/descriptors", "medians of the second half less those of the first",
               median(middle, steady.cend(), &Sample::descriptors) -
                   median(steady.cbegin(), middle, &Sample::descriptors),
               1);
  EXPECT_LE(most->descriptors - least->descriptors, 12);  // files open for a moment
  expectAtMost(
      "soak/threads", "medians of the second half less those of the first",
      median(middle, steady.cend(), &Sample::threads) - median(steady.cbegin(), middle, &Sample::threads), 1);
  expectAtMost(
      "soak/latency", "median answer of the second half over that of the first",
      median(middle, steady.cend(), &Sample::answer_ms) / median(steady.cbegin(), middle, &Sample::answer_ms),
      3);
}

}  // namespace
}  // namespace overfly::test
