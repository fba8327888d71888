#include "capture/pose/mavlink/signer.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "capture/pose/mavlink/parser.h"

namespace overfly::mavlink {
namespace {

constexpr std::int64_t kNow_us = 1'700'000'000'000'000;

Key countingKey() {
  Key key;
  for (std::size_t i = 0; i < key.size(); ++i) key[i] = static_cast<std::uint8_t>(i);
  return key;
}

std::vector<std::uint8_t> signedHeartbeat(Signer& signer, std::uint8_t sequence,
                                          std::int64_t unix_us = kNow_us) {
  auto packet = encode(Heartbeat{}, {1, 1}, sequence, true);
  signer.sign(packet, unix_us);
  return packet;
}

Signer::Verdict verdictOf(Signer& signer, std::span<const std::uint8_t> bytes) {
  Parser parser;
  auto verdict = Signer::Verdict::Unsigned;
  int count = 0;
  parser.feed(bytes, [&](const Packet& packet, std::span<const std::uint8_t> raw) {
    ++count;
    verdict = signer.verify(packet, raw);
  });
  EXPECT_EQ(count, 1);
  return verdict;
}

// What node-mavlink 2.3.0 signs with the same key, link and time.
TEST(MavlinkSigner, AKnownSignatureComesOutByteForByte) {
  Heartbeat heartbeat;
  heartbeat.custom_mode = 65536;
  heartbeat.type = 2;
  heartbeat.autopilot = 3;
  heartbeat.base_mode = 209;
  heartbeat.system_status = 4;
  auto packet = encode(heartbeat, {1, 1}, 9, true);
  Signer signer(countingKey(), 5);
  signer.sign(packet, kNow_us);
  std::string hex;
  for (const std::uint8_t byte : packet) hex += fmt::format("{:02x}", byte);
  EXPECT_EQ(hex, "fd090100090101000000000001000203d1040305940500e06f9e7519e51b7971e1b5");
}

TEST(MavlinkSigner, GoodSignaturesPassAndOthersDoNot) {
  Signer sender(countingKey(), 1), receiver(countingKey(), 2);
  const auto first = signedHeartbeat(sender, 0), second = signedHeartbeat(sender, 1);
  EXPECT_EQ(verdictOf(receiver, first), Signer::Verdict::Good);
  EXPECT_EQ(verdictOf(receiver, second), Signer::Verdict::Good);
  EXPECT_EQ(verdictOf(receiver, second), Signer::Verdict::Replayed);
  EXPECT_EQ(verdictOf(receiver, first), Signer::Verdict::Replayed);
  EXPECT_EQ(verdictOf(receiver, encode(Heartbeat{}, {1, 1}, 2)), Signer::Verdict::Unsigned);
  Key other = countingKey();
  other[31] = 0;
  Signer stranger(other, 1);
  EXPECT_EQ(verdictOf(receiver, signedHeartbeat(stranger, 3, kNow_us + 1'000'000)),
            Signer::Verdict::WrongKey);
}

TEST(MavlinkSigner, ANewStreamFromLongAgoIsRefused) {
  Signer sender(countingKey(), 1), late(countingKey(), 9), receiver(countingKey(), 2);
  EXPECT_EQ(verdictOf(receiver, signedHeartbeat(sender, 0)), Signer::Verdict::Good);
  EXPECT_EQ(verdictOf(receiver, signedHeartbeat(late, 0, kNow_us - 61'000'000)), Signer::Verdict::Replayed);
  EXPECT_EQ(verdictOf(receiver, signedHeartbeat(late, 0, kNow_us - 59'000'000)), Signer::Verdict::Good);
}

// A clock that was set back must not make our packets look replayed.
TEST(MavlinkSigner, TimesGoUpWhateverTheClockDoes) {
  Signer sender(countingKey(), 1), receiver(countingKey(), 2);
  for (const std::int64_t shift_s : {0, 3600, -3600, -1'700'000'000, 0}) {
    const auto packet = signedHeartbeat(sender, 0, kNow_us + shift_s * 1'000'000);
    EXPECT_EQ(verdictOf(receiver, packet), Signer::Verdict::Good) << shift_s;
  }
}

TEST(MavlinkSigner, KeysAreReadAsBytesOrDigits) {
  const auto folder = std::filesystem::temp_directory_path() / ("overfly_key_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  const auto write = [&](const std::string& text) {
    std::ofstream(folder / "key", std::ios::binary) << text;
    return readKey(folder / "key");
  };
  std::string digits, bytes;
  for (const std::uint8_t byte : countingKey()) {
    digits += fmt::format("{:02X}", byte);
    bytes += static_cast<char>(byte);
  }
  EXPECT_EQ(write(digits + "\n"), countingKey());
  EXPECT_EQ(write(bytes), countingKey());
  EXPECT_EQ(write(digits.substr(2)).error().code, ErrorCode::BadSettings);
  EXPECT_EQ(write("x" + digits.substr(1)).error().code, ErrorCode::BadSettings);
  EXPECT_EQ(readKey(folder / "absent").error().code, ErrorCode::NotFound);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace overfly::mavlink
