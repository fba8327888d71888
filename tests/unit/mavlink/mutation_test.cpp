#include <gtest/gtest.h>

#include <cstdlib>
#include <set>
#include <string>

#include "capture/pose/mavlink/parser.h"
#include "tests/unit/mavlink/random_message.h"

namespace overfly::mavlink {
namespace {

// CRC-16/MCRF4XX bit by bit, written apart from the codec's.
std::uint16_t slowCrc(std::span<const std::uint8_t> bytes, std::uint8_t extra) {
  std::uint16_t crc = 0xFFFF;
  const auto add = [&crc](std::uint8_t byte) {
    crc = static_cast<std::uint16_t>(crc ^ byte);
    for (int bit = 0; bit < 8; ++bit)
      crc = static_cast<std::uint16_t>((crc & 1) != 0 ? (crc >> 1) ^ 0x8408 : crc >> 1);
  };
  for (const std::uint8_t byte : bytes) add(byte);
  add(extra);
  return crc;
}

enum class Mutation { None, FlipBit, ChangeByte, LoseByte, AddByte, CutOff, Noise };

struct Sent {
  std::vector<std::uint8_t> bytes;  // as sent, if it was left alone
  bool whole = false;
};

// 10 million bytes of packets, every second of them damaged in some way, in pieces of any size: no crash,
// nothing accepted whose checksum is wrong, and every packet that was left alone comes out, whatever stood
// before it.
TEST(MavlinkMutations, DamagedPacketsAreRefusedAndWholeOnesAreFound) {
  std::uint64_t seed = 20260101;
  if (const char* text = std::getenv("OVERFLY_SEED")) seed = std::strtoull(text, nullptr, 10);
  RecordProperty("seed", std::to_string(seed));
  std::mt19937_64 random(seed);
  constexpr std::size_t kBytes = 10'000'000;

  Parser parser;
  std::size_t bytes = 0, whole = 0, found = 0, strange = 0;
  std::multiset<std::vector<std::uint8_t>> expected;
  std::vector<std::uint8_t> stream;
  const auto handler = [&](const Packet& packet, std::span<const std::uint8_t> raw) {
    const std::size_t end = raw.size() - kChecksum - (packet.has_signature ? kSignature : 0);
    const std::uint16_t crc = slowCrc(raw.subspan(1, end - 1), packet.info->crc_extra);
    ASSERT_EQ(raw[end] | raw[end + 1] << 8, crc) << "accepted with a wrong checksum";
    const auto known = expected.find(std::vector<std::uint8_t>(raw.begin(), raw.end()));
    if (known == expected.end()) {
      ++strange;  // damaged, and its checksum fits by chance: 1 in 65,536 of those that are more than a burst
    } else {
      ++found;
      expected.erase(known);
    }
  };
  for (std::uint8_t sequence = 0; bytes < kBytes; ++sequence) {
    auto packet = randomPacket(random, {static_cast<std::uint8_t>(random() % 3), 1}, sequence);
    const auto mutation = random() % 2 == 0 ? Mutation::None : static_cast<Mutation>(1 + random() % 6);
    // Not the last byte: where the one behind it happens to be the same, nothing is damaged.
    const std::size_t at = random() % (packet.size() - 1);
    const auto place = packet.begin() + static_cast<std::ptrdiff_t>(at);
    switch (mutation) {
      case Mutation::None:
        ++whole;
        expected.insert(packet);
        break;
      case Mutation::FlipBit:
        *place = static_cast<std::uint8_t>(*place ^ (1U << (random() % 8)));
        break;
      case Mutation::ChangeByte:
        *place = static_cast<std::uint8_t>(*place + 1 + random() % 255);
        break;
      case Mutation::LoseByte:
        packet.erase(place);
        break;
      case Mutation::AddByte: {
        const auto added = static_cast<std::uint8_t>(random() % 3 == 0 ? kStart2 : random());
        if (at == 0 || (at == 1 && added == kStart2)) {  // in front of a packet: it is whole
          ++whole;
          expected.insert(packet);
        }
        packet.insert(place, added);
        break;
      }
      case Mutation::CutOff:
        packet.resize(at);
        break;
      case Mutation::Noise:
        packet.clear();
        for (std::size_t i = random() % 300; i > 0; --i)
          packet.push_back(static_cast<std::uint8_t>(random()));
        break;
    }
    bytes += packet.size();
    stream.insert(stream.end(), packet.begin(), packet.end());
    if (stream.size() < 1 + random() % 4000) continue;
    parser.feed(stream, handler);
    stream.clear();
    if (HasFatalFailure()) return;
  }
  // What a half packet at the end still holds back comes with more bytes.
  stream.insert(stream.end(), kMaxPacket + 20, 0);
  parser.feed(stream, handler);
  RecordProperty("bytes", std::to_string(bytes));
  RecordProperty("by_chance", std::to_string(strange));
  EXPECT_GT(whole, 40'000U);
  // 16 bits of checksum let one in 65,536 pass that is damaged in several places, and it may hide some behind
  // it.
  EXPECT_LE(strange, 12U) << "damaged packets accepted";
  EXPECT_LE(whole - found, 8 * strange) << "whole packets that did not come out, of " << whole;
}

// Behind noise of any kind the very next whole packet comes out.
TEST(MavlinkMutations, TheNextWholePacketComesOutBehindAnything) {
  std::mt19937_64 random(5);
  for (int i = 0; i < 20'000; ++i) {
    Parser parser;
    std::vector<std::uint8_t> stream;
    for (std::size_t n = random() % 40; n > 0; --n)
      stream.push_back(static_cast<std::uint8_t>(random() % 4 == 0   ? kStart2
                                                 : random() % 5 == 0 ? kStart1
                                                                     : random() % 40));
    const auto packet = randomPacket(random, {1, 1}, 0);
    stream.insert(stream.end(), packet.begin(), packet.end());
    stream.insert(stream.end(), kMaxPacket, 0);  // lets a false beginning run out
    bool found = false;
    parser.feed(stream, [&](const Packet&, std::span<const std::uint8_t> raw) {
      found = found || std::equal(raw.begin(), raw.end(), packet.begin(), packet.end());
    });
    ASSERT_TRUE(found) << "round " << i;
  }
}

}  // namespace
}  // namespace overfly::mavlink
