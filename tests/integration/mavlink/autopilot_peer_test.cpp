#include <gtest/gtest.h>
#include <time.h>

#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "capture/geo/geodetic.h"
#include "capture/pose/autopilot.h"
#ifdef OVERFLY_NODE
#include "tests/integration/mavlink/peer.h"
#endif

namespace overfly::capture {
namespace {

using namespace std::chrono_literals;

#ifdef OVERFLY_NODE
using Json = nlohmann::json;

std::int64_t nowNs() {
  timespec t{};
  clock_gettime(CLOCK_BOOTTIME, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

template <class Condition>
bool eventually(Condition&& condition) {
  for (int i = 0; i < 3000; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(10ms);
  }
  return false;
}

// What the peer heard, by name of the message, until it has heard `enough`.
std::map<std::string, std::vector<Json>> hear(
    NodeProgram& node, const std::function<bool(const std::map<std::string, std::vector<Json>>&)>& enough) {
  std::map<std::string, std::vector<Json>> heard;
  for (int i = 0; i < 2000 && !enough(heard); ++i) {
    const std::string text = node.read();
    if (text.empty()) break;
    const Json line = Json::parse(text, nullptr, false);
    if (!line.is_discarded()) heard[line["name"]].push_back(line);
  }
  return heard;
}

void flyWithPeer(int port, bool with_signatures) {
  AutopilotOptions options;
  options.telemetry.height = HeightFrom::Ellipsoid;
  std::string key_hex;
  if (with_signatures) {
    mavlink::Key key;
    for (std::size_t i = 0; i < key.size(); ++i) key[i] = static_cast<std::uint8_t>(200 - i);
    options.key = key;
    for (const std::uint8_t byte : key) {
      char digits[3];
      std::snprintf(digits, sizeof digits, "%02x", byte);
      key_hex += digits;
    }
  }
  auto transport = makeTransport("udp:127.0.0.1:" + std::to_string(port));
  ASSERT_TRUE(transport);
  Autopilot autopilot(std::move(*transport), options);
  autopilot.start();
  std::vector<std::string> arguments{OVERFLY_SOURCE_DIR "/tests/integration/mavlink/autopilot.js",
                                     std::to_string(port)};
  if (with_signatures) arguments.push_back(key_hex);
  NodeProgram node(arguments);

  ASSERT_TRUE(eventually([&] {
    const AutopilotStatus status = autopilot.status();
    return status.telemetry.poses > 150 && status.telemetry.clock_paired &&
           status.events.contains("commands answered") && status.events.at("commands answered") >= 10;
  })) << autopilot.status().problem;
  Frame frame;
  frame.name = "00000007.jpg";
  frame.time_ns = nowNs();
  autopilot.imageCaptured(frame);
  autopilot.say(4, "the camera is gone");

  // The peer flies north at 15 m/s.
  const std::int64_t then = nowNs() - 1'000'000'000;
  ASSERT_TRUE(eventually([&] { return autopilot.poses().at(then + 500'000'000).has_value(); }));
  const auto a = autopilot.poses().at(then), b = autopilot.poses().at(then + 500'000'000);
  ASSERT_TRUE(a && b) << (a ? "" : a.error().message);
  EXPECT_NEAR((b->position_in_ecef - a->position_in_ecef).norm(), 7.5, 0.15);
  EXPECT_NEAR(geo::geodeticFromEcef(a->position_in_ecef).height_m, 535.0, 0.1);
  const AutopilotStatus status = autopilot.status();
  ASSERT_TRUE(status.telemetry.home_height_m);
  EXPECT_NEAR(*status.telemetry.home_height_m, 435.0, 0.1);
  EXPECT_EQ(status.packets.bad, 0U);
  EXPECT_EQ(status.packets.unknown, 0U);
  EXPECT_EQ(status.state, AutopilotState::Talking);
  EXPECT_TRUE(status.armed);
  EXPECT_TRUE(autopilot.utcOffset(nowNs()).has_value());

  const auto heard = hear(node, [](const auto& all) {
    return all.contains("STATUSTEXT") && all.contains("CAMERA_IMAGE_CAPTURED") && all.contains("HEARTBEAT") &&
           all.contains("TIMESYNC") && all.contains("COMMAND_LONG") && all.contains("COMMAND_ACK") &&
           all.at("COMMAND_ACK").size() >= 10;
  });
  const auto count = [&](const std::string& name) {
    return heard.contains(name) ? heard.at(name).size() : 0;
  };
  for (const auto& [name, lines] : heard) {
    for (const Json& line : lines) {
      EXPECT_EQ(line["system"], 1) << name;
      EXPECT_EQ(line["component"], 100) << name;
      EXPECT_EQ(line["signed"], with_signatures ? Json(true) : Json(nullptr)) << name;
    }
  }
  // Both styles of request, one answer each.
  EXPECT_EQ(count("CAMERA_INFORMATION"), 2U);
  EXPECT_EQ(count("CAMERA_SETTINGS"), 2U);
  EXPECT_EQ(count("STORAGE_INFORMATION"), 2U);
  EXPECT_EQ(count("CAMERA_CAPTURE_STATUS"), 2U);
  ASSERT_GE(count("COMMAND_ACK"), 10U);
  std::map<int, std::multiset<int>> results;
  for (const Json& ack : heard.at("COMMAND_ACK"))
    results[ack["fields"]["command"]].insert(ack["fields"]["result"].get<int>());
  EXPECT_EQ(results[512].count(0), 4U);
  EXPECT_EQ(results[512].count(3), 1U) << "a message that there is not";
  EXPECT_EQ(results[2002].count(2), 1U) << "an image that was not taken yet";
  ASSERT_GE(count("CAMERA_IMAGE_CAPTURED"), 1U);
  EXPECT_EQ(heard.at("CAMERA_IMAGE_CAPTURED")[0]["fields"]["file_url"], "00000007.jpg");
  ASSERT_GE(count("STATUSTEXT"), 1U);
  EXPECT_EQ(heard.at("STATUSTEXT")[0]["fields"]["text"], "the camera is gone");
  std::set<int> streams;
  for (const Json& command : heard.at("COMMAND_LONG"))
    if (command["fields"]["command"] == 511) streams.insert(command["fields"]["param1"].get<int>());
  EXPECT_EQ(streams, (std::set<int>{2, 24, 31, 33}));
}
#endif

TEST(MavlinkPeer, AFlightOfAnotherImplementationGivesPosesAndAnswers) {
#ifndef OVERFLY_NODE
  GTEST_SKIP() << "node-mavlink could not be installed";
#else
  flyWithPeer(24'561, false);
#endif
}

TEST(MavlinkPeer, TheSameWithSignatures) {
#ifndef OVERFLY_NODE
  GTEST_SKIP() << "node-mavlink could not be installed";
#else
  flyWithPeer(24'562, true);
#endif
}

}  // namespace
}  // namespace overfly::capture
