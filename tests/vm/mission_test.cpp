#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>
#include <vector>

#include "tests/integration/link/client.h"
#include "tests/integration/pull/mirror_check.h"
#include "tests/shell.h"
#include "tests/vm/installed_service.h"
#ifdef OVERFLY_NODE
#include "tests/integration/mavlink/peer.h"
#endif

// A flight as it is on a drone, all of it real but the ground: systemd, the kernel's camera and its GPIO
// lines, an autopilot on the network, and a station on the other side that pulls the map.
namespace overfly::vm {
namespace {

using namespace std::chrono_literals;
using Json = nlohmann::json;

class Mission : public InstalledService {
 protected:
  Json status() {
    return Json::parse(test::fetch(url() + "/status", {}, "GET", {}, 60000).body, nullptr, false);
  }
  // Until a number in the status is at least so much.
  bool waitFor(const char* pointer, double least, std::chrono::seconds limit) {
    const auto until = std::chrono::steady_clock::now() + limit;
    while (std::chrono::steady_clock::now() < until) {
      const Json now = status();
      const Json::json_pointer where(pointer);
      if (!now.is_discarded() && now.contains(where) && now[where].is_number() &&
          now[where].get<double>() >= least)
        return true;
      std::this_thread::sleep_for(500ms);
    }
    return false;
  }
};

#ifdef OVERFLY_NODE

constexpr int kInterval_ms = 200, kLag_ms = 40, kBuffers = 30;

constexpr const char* kSettings = R"(
[camera]
format = "grey"
buffers = 30
[pose]
mavlink = "udp:14550"
boresight_deg = [0, -90, 0]
[gpio]
chip = "gpiochip0"
exposure_line = 3
expected_lag_ms = 40
[map]
gsd_m = 1
[adjust]
mode = "off"
[quality]
mode = "realtime"
[preview]
enabled = false
[sweep]
images = 4
)";

// A bank of eight lines of gpio-sim as gpiochip0, and the kernel's own word on each frame handed out.
constexpr const char* kLines = R"(
set -e
mountpoint -q /sys/kernel/config || mount -t configfs configfs /sys/kernel/config
mountpoint -q /sys/kernel/tracing || mount -t tracefs tracefs /sys/kernel/tracing
modprobe gpio-sim
mkdir -p /sys/kernel/config/gpio-sim/hotshoe/bank
echo 8 >/sys/kernel/config/gpio-sim/hotshoe/bank/num_lines
echo 1 >/sys/kernel/config/gpio-sim/hotshoe/live
udevadm settle
test -e /dev/gpiochip0
echo 1 >/sys/kernel/tracing/events/v4l2/v4l2_dqbuf/enable
)";

// What the shutter wrote down (tests/vm/pulses).
struct Shutter {
  std::map<std::uint64_t, std::int64_t> frames;  // stamp of the kernel by its number
  std::map<std::uint64_t, std::int64_t> waited;  // from there until it was handed out
  std::vector<std::int64_t> pulses;              // when they were set
  std::size_t missed = 0, spurious = 0;
};

Shutter shutterFrom(const std::string& text) {
  Shutter out;
  std::istringstream lines(text);
  for (std::string kind; lines >> kind;) {
    std::int64_t a = 0, b = 0, c = 0;
    lines >> a;
    if (kind == "frame" || kind == "pulse") lines >> b;
    if (kind == "frame") {
      lines >> c;
      out.frames[static_cast<std::uint64_t>(a)] = b;
      out.waited[static_cast<std::uint64_t>(a)] = c - b;
    }
    if (kind == "pulse") out.pulses.push_back(b);
    if (kind == "missed") ++out.missed;
    if (kind == "spurious") ++out.spurious;
  }
  return out;
}

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values.at(static_cast<std::size_t>(share * static_cast<double>(values.size() - 1)));
}

TEST_F(Mission, IsFlownRecordedStampedMappedAndPulled) {
  // 1080p from the kernel's camera, which makes five of them a second; grey, because plain colour would be
  // 15 MB a second for an emulated disk (a real camera sends JPEG).
  const char* asked = std::getenv("OVERFLY_VM_FLIGHT_SECONDS");
  const int seconds = asked != nullptr ? std::atoi(asked) : 60;
  install(1920, 1080, kSettings, 12ULL << 30);
  if (HasFatalFailure()) return;
  const auto lines = guest_->run(kLines);
  ASSERT_EQ(lines.status, 0) << lines.output;
  ASSERT_TRUE(waitForFrames(5, 120s)) << journal();

  // It hovers, because the camera shows the same picture all the time.
  NodeProgram autopilot({OVERFLY_SOURCE_DIR "/tests/integration/mavlink/autopilot.js",
                         std::to_string(guest_->mavlinkPort()), "-", "0"});
  std::map<std::string, int> heard;
  std::jthread listening([&] {
    for (std::string line; !(line = autopilot.read()).empty();) {
      const Json said = Json::parse(line, nullptr, false);
      if (!said.is_discarded()) ++heard[said["name"]];
    }
  });
  EXPECT_TRUE(waitFor("/live/poses/with", 3, 120s)) << status().dump(1) << journal();

  const std::string shutter =
      "systemd-run --unit=shutter /mnt/host/tests/vm/pulses/vm_pulses "
      "$(ls /sys/devices/platform/gpio-sim.*/gpiochip0/sim_gpio3/pull) /run/shutter " +
      std::to_string(kInterval_ms) + " " + std::to_string(kLag_ms) + " " + std::to_string(seconds);
  const auto pulsing = guest_->run(shutter);
  ASSERT_EQ(pulsing.status, 0) << pulsing.output;
  EXPECT_TRUE(waitFor("/live/pulses/matched", 1, 60s)) << status().dump(1) << journal();

  // The station on the ground, while the drone flies.
  const std::string pull = "'" OVERFLY_PROGRAM "' pull '" + url() + "' " + folder_.string();
  const auto during = test::shell(pull + "/mirror --once --give-up 120 2>&1");
  EXPECT_EQ(during.status, 0) << during.output;

  const auto flown =
      guest_->runUntilGood("! systemctl is-active --quiet shutter", std::chrono::seconds(seconds + 300));
  EXPECT_EQ(flown.status, 0);
  const Json at_end = status();
  // Of the threads by their names, in hundredths of a second.
  const auto cpu = guest_->run(
      "for t in /proc/$(systemctl show -P MainPID overflyd)/task/*; do "
      "echo $(cat $t/comm) $(sed 's/.*) //' $t/stat | awk '{print $12 + $13}'); done");
  std::map<std::string, double> cpu_s;
  std::istringstream threads(cpu.output);
  std::string name;
  for (double ticks = 0; threads >> name >> ticks;) cpu_s[name] += ticks / 100;
  ASSERT_EQ(guest_->run("systemctl stop overflyd", 300s).status, 0) << journal();
  autopilot.closeInput();

  // Every frame of the camera is in the recording, from the first to the last.
  const auto table = guest_->run("cut -c 10- /var/lib/overfly/map/*/flight-1/frames.tbl");
  ASSERT_EQ(table.status, 0) << table.output;
  std::map<std::uint64_t, Json> frames;  // by number; the last line counts
  std::istringstream rows(table.output);
  for (std::string row; std::getline(rows, row);) {
    const Json frame = Json::parse(row);
    frames[frame["seq"]] = frame;
  }
  ASSERT_FALSE(frames.empty());
  std::size_t with_pose = 0;
  for (const auto& [number, frame] : frames) with_pose += frame.contains("pose") ? 1 : 0;

  // What the pulses made of the times: each frame against the shutter's own record.
  const Shutter truth = shutterFrom(guest_->run("cat /run/shutter").output);
  ASSERT_GT(truth.pulses.size(), 100U);
  ASSERT_GT(truth.frames.size(), 100U);
  // From the first to the last that the shutter was there for. A number is left out when no buffer is free,
  // and also when the emulated machine does not let the driver's own thread run in time: only then do the
  // next pictures not wait for anybody.
  std::size_t missing = 0, by_the_driver = 0, taken = 0;
  for (std::uint64_t number = truth.frames.begin()->first;
       number <= truth.frames.rbegin()->first &&
       (!truth.frames.contains(number) || truth.frames.at(number) <= truth.pulses.back());
       ++number, ++taken) {
    if (frames.contains(number)) continue;
    const auto next = truth.waited.upper_bound(number);
    const bool free = !truth.frames.contains(number) && next != truth.waited.end() &&
                      next->second < (kBuffers - 5) * kInterval_ms * 1'000'000LL / 2;
    ++(free ? by_the_driver : missing);
  }
  // The emulated machine stands still for seconds now and then.
  EXPECT_LE(missing * 50, taken);
  EXPECT_LE(by_the_driver * 100, taken);
  EXPECT_GE(taken + 10, static_cast<std::size_t>(seconds) * 1000 / kInterval_ms);
  std::size_t right = 0, wrong = 0, without = 0;
  std::vector<double> errors_us, unmatched_us;
  for (const auto& [number, stamp] : truth.frames) {
    const auto frame = frames.find(number);
    if (frame == frames.end()) continue;
    const std::int64_t time = frame->second["time"], due = stamp - kLag_ms * 1'000'000LL;
    if (due < truth.pulses.front() - 50'000'000 || due > truth.pulses.back() + 50'000'000) continue;
    // Its pulse, where there was one.
    const auto nearest = [&](std::int64_t t) {
      return *std::min_element(truth.pulses.begin(), truth.pulses.end(), [t](std::int64_t a, std::int64_t b) {
        return std::abs(a - t) < std::abs(b - t);
      });
    };
    const std::int64_t own = nearest(due);
    const bool stamped =
        frame->second.value("time_sigma", std::int64_t{0}) <= 1000 && frame->second.contains("time_sigma");
    if (!stamped) {
      ++without;
      unmatched_us.push_back(std::abs(static_cast<double>(time - due)) / 1000);
    } else if (std::abs(own - due) < kInterval_ms * 500'000LL && std::abs(time - own) < 50'000'000) {
      ++right;
      errors_us.push_back(static_cast<double>(time - own) / 1000);
    } else {
      ++wrong;
      if (wrong <= 5 || wrong % 50 == 0)
        std::printf("exposure %llu has a time %.1f ms after its pulse\n",
                    static_cast<unsigned long long>(number), static_cast<double>(time - own) / 1e6);
    }
  }
  ASSERT_FALSE(errors_us.empty()) << at_end.dump(1);
  // Pictures and pulses come as regularly as a clock: after a stall the lag may be wrong by one interval
  // until that shows. Still open, see docs/live-sources.md.
  EXPECT_LE(wrong * 5, right);
  EXPECT_EQ(at_end["live"]["autopilot"]["clock"]["by"], "timesync");
  EXPECT_GT(heard["CAMERA_IMAGE_CAPTURED"], 0);
  EXPECT_GT(at_end["frames"]["mapped"], 0);
  EXPECT_GT(at_end["tiles"]["written"], 0);
  EXPECT_GT(right, without / 2);
  EXPECT_LT(std::abs(quantile(errors_us, 0.5)), 2000);

  // After landing: what the ground has pulled is what the drone has, byte for byte.
  const auto served = guest_->run(
      "cp /var/lib/overfly/map/*/map.overfly /run/landed.overfly && systemd-run --unit=serving "
      "/usr/bin/overfly "
      "serve /run/landed.overfly --listen 0.0.0.0:8420 --set link.require_token=false");
  ASSERT_EQ(served.status, 0) << served.output << guest_->run("find /var/lib/overfly | head -50").output;
  const auto after = test::shell(pull + "/landed --once --give-up 120 2>&1");
  EXPECT_EQ(after.status, 0) << after.output;
  const auto copied = guest_->run("cat /run/landed.overfly", 300s);
  ASSERT_EQ(copied.status, 0);
  std::ofstream(folder_ / "landed.overfly", std::ios::binary) << copied.output;
  test::expectSame(folder_ / "landed.overfly", folder_ / "landed" / "landed.overfly");

  std::printf(
      "%zu exposures of 1920x1080 in %d s, %zu of them dropped, %zu skipped by the camera's driver itself; "
      "%zu "
      "recorded with a pose, %d mapped, %d tiles written\n"
      "%zu frames stamped by their own pulse, %zu by another's, %zu by the camera's stamp (%zu pulses left "
      "out, %zu spurious)\n"
      "time against the shutter: median %.0f us, 99th percentile %.0f us; before the "
      "lag was known or without a pulse: median %.0f us\n"
      "capture: %.0f ms of CPU a frame, emulated; mapping %.0f s, GPU %.0f s in all; the ground was told of "
      "%d pictures\n",
      taken, seconds, missing, by_the_driver, with_pose, at_end["frames"]["mapped"].get<int>(),
      at_end["tiles"]["written"].get<int>(), right, wrong, without, truth.missed, truth.spurious,
      quantile(errors_us, 0.5), quantile(errors_us, 0.99),
      unmatched_us.empty() ? 0 : quantile(unmatched_us, 0.5),
      1000 * cpu_s["capture"] / at_end["frames"]["seen"].get<double>(), cpu_s["mapping"],
      cpu_s["gl"] + cpu_s["llvmpipe-0"] + cpu_s["llvmpipe-1"], heard["CAMERA_IMAGE_CAPTURED"]);
}

#else
TEST_F(Mission, IsFlownRecordedStampedMappedAndPulled) {
  GTEST_SKIP() << "node-mavlink is not here: npm could not fetch it";
}
#endif

}  // namespace
}  // namespace overfly::vm
