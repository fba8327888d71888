#include "capture/pose/mavlink/codec.h"

#include <gtest/gtest.h>

#include <string>

#include "capture/pose/mavlink/parser.h"
#include "tests/unit/mavlink/random_message.h"

namespace overfly::mavlink {
namespace {

std::vector<std::uint8_t> fromHex(const std::string& hex) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(hex.substr(i, 2), nullptr, 16)));
  return bytes;
}

std::vector<Packet> parsed(std::span<const std::uint8_t> bytes) {
  Parser parser;
  std::vector<Packet> packets;
  parser.feed(bytes, [&](const Packet& packet, std::span<const std::uint8_t>) { packets.push_back(packet); });
  return packets;
}

// Packets that another implementation made (node-mavlink 2.3.0).
TEST(MavlinkCodec, KnownPacketsComeOutByteForByte) {
  Heartbeat heartbeat;
  heartbeat.custom_mode = 65536;
  heartbeat.type = 2;
  heartbeat.autopilot = 3;
  heartbeat.base_mode = 209;
  heartbeat.system_status = 4;
  EXPECT_EQ(encode(heartbeat, {1, 1}, 7), fromHex("fd090000070101000000000001000203d104037500"));
  Timesync sync;
  sync.ts1 = 123456789012345;
  EXPECT_EQ(encode(sync, {1, 1}, 200), fromHex("fd0e0000c801016f0000000000000000000079df0d8648706349"));
}

TEST(MavlinkCodec, AVersionOnePacketIsRead) {
  const auto packets = parsed(fromHex("fe0907010100000001000203d104032b01"));
  ASSERT_EQ(packets.size(), 1U);
  EXPECT_EQ(packets[0].version, 1);
  EXPECT_EQ(packets[0].sequence, 7);
  const auto heartbeat = decode<Heartbeat>(packets[0]);
  EXPECT_EQ(heartbeat.custom_mode, 65536U);
  EXPECT_EQ(heartbeat.base_mode, 209);
}

TEST(MavlinkCodec, EveryMessageComesBackAsItWas) {
  std::mt19937_64 random(7);
  forEachMessage([&]<class M>(std::type_identity<M>) {
    for (int i = 0; i < 200; ++i) {
      const M message = randomMessage<M>(random);
      const auto packets = parsed(encode(message, {42, 191}, static_cast<std::uint8_t>(i)));
      ASSERT_EQ(packets.size(), 1U) << M::kName;
      EXPECT_EQ(packets[0].info->id, M::kId);
      EXPECT_EQ(packets[0].from, (Address{42, 191}));
      EXPECT_EQ(payloadOf(decode<M>(packets[0])), payloadOf(message)) << M::kName;
    }
  });
}

TEST(MavlinkCodec, APacketOfZerosKeepsItsFirstByte) {
  const auto packet = encode(Timesync{}, {1, 1}, 0);
  EXPECT_EQ(packet[1], 1);
  EXPECT_EQ(parsed(packet).size(), 1U);
}

// A sender that is newer than we are: longer payloads of known messages.
TEST(MavlinkCodec, UnknownExtensionsAreLetPass) {
  const Timesync sync{5, 6, 7, 8};
  auto payload = payloadOf(sync);
  payload.insert(payload.end(), {9, 9, 9});
  const auto packets = parsed(packetOf(*findMessage(Timesync::kId), payload, {1, 1}, 0, false));
  ASSERT_EQ(packets.size(), 1U);
  EXPECT_EQ(payloadOf(decode<Timesync>(packets[0])), payloadOf(sync));
}

TEST(MavlinkParser, PiecesOfAnySizeGiveTheSamePackets) {
  std::mt19937_64 random(11);
  std::vector<std::uint8_t> stream;
  for (int i = 0; i < 300; ++i) {
    const auto packet = randomPacket(random, {1, 1}, static_cast<std::uint8_t>(i));
    stream.insert(stream.end(), packet.begin(), packet.end());
  }
  for (const std::size_t piece : {1U, 2U, 7U, 100U, 5000U}) {
    Parser parser;
    int count = 0;
    for (std::size_t at = 0; at < stream.size(); at += piece)
      parser.feed(std::span(stream).subspan(at, std::min(piece, stream.size() - at)),
                  [&](const Packet&, std::span<const std::uint8_t>) { ++count; });
    EXPECT_EQ(count, 300) << piece;
    EXPECT_EQ(parser.counts(), (ParserCounts{300, 0, 0, 0, 0})) << piece;
  }
}

TEST(MavlinkParser, MessagesThatWeDoNotSpeakAreCountedAndPassed) {
  const MessageInfo strange{11020, "STRANGE", 99, 4, 4};
  std::vector<std::uint8_t> stream;
  for (std::uint8_t i = 0; i < 10; ++i) {
    const auto packet = i % 2 == 0
                            ? packetOf(strange, std::vector<std::uint8_t>{1, kStart2, 3, 4}, {1, 1}, i, false)
                            : encode(Heartbeat{}, {1, 1}, i);
    stream.insert(stream.end(), packet.begin(), packet.end());
  }
  Parser parser;
  parser.feed(stream, [](const Packet&, std::span<const std::uint8_t>) {});
  EXPECT_EQ(parser.counts(), (ParserCounts{5, 5, 0, 0, 0}));
}

TEST(MavlinkParser, LostPacketsAreCountedPerSender) {
  std::vector<std::uint8_t> stream;
  const auto send = [&](std::uint8_t system, std::uint8_t sequence) {
    const auto packet = encode(Heartbeat{}, {system, 1}, sequence);
    stream.insert(stream.end(), packet.begin(), packet.end());
  };
  send(1, 250);
  send(2, 9);
  send(1, 251);
  send(1, 255);  // 3 lost
  send(2, 10);
  send(1, 2);  // 2 lost
  send(2, 3);  // began anew
  Parser parser;
  parser.feed(stream, [](const Packet&, std::span<const std::uint8_t>) {});
  EXPECT_EQ(parser.counts().lost, 3U + 2U);
}

// Flags that change the packet's meaning and that we do not know: the packet must not be read.
TEST(MavlinkParser, UnknownIncompatibleFlagsAreRefused) {
  auto packet = encode(Heartbeat{}, {1, 1}, 0);
  packet[2] = 0x02;
  std::uint16_t crc = 0xFFFF;
  for (std::size_t i = 1; i < packet.size() - 2; ++i) crc = crcStep(crc, packet[i]);
  crc = crcStep(crc, findMessage(0)->crc_extra);
  packet[packet.size() - 2] = static_cast<std::uint8_t>(crc);
  packet[packet.size() - 1] = static_cast<std::uint8_t>(crc >> 8);
  EXPECT_TRUE(parsed(packet).empty());
}

}  // namespace
}  // namespace overfly::mavlink
