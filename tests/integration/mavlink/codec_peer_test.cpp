#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <thread>

#include "capture/pose/mavlink/parser.h"
#include "tests/unit/mavlink/random_message.h"
#ifdef OVERFLY_NODE
#include "tests/integration/mavlink/peer.h"
#endif

namespace overfly::mavlink {
namespace {

#ifdef OVERFLY_NODE
using Json = nlohmann::json;

template <class T>
Json jsonOf(const T& value) {
  if constexpr (std::is_same_v<T, std::int64_t> || std::is_same_v<T, std::uint64_t>) {
    return std::to_string(value);
  } else {
    return value;
  }
}
template <std::size_t N>
Json jsonOf(const Text<N>& text) {
  return std::string(text.data(), ::strnlen(text.data(), N));
}

template <class M>
Json fieldsOf(const M& message) {
  Json fields = Json::object();
  M::fields(message,
            [&](std::string_view name, const auto& field) { fields[std::string(name)] = jsonOf(field); });
  return fields;
}

std::string hexOf(std::span<const std::uint8_t> bytes) {
  std::string hex;
  char digits[3];
  for (const std::uint8_t byte : bytes) {
    std::snprintf(digits, sizeof digits, "%02x", byte);
    hex += digits;
  }
  return hex;
}

std::vector<std::uint8_t> fromHex(const std::string& hex) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(hex.substr(i, 2), nullptr, 16)));
  return bytes;
}

// A text has no bytes behind its end.
template <class M>
void endTexts(M& message) {
  M::fields(message, [&]<class F>(std::string_view, F& field) {
    if constexpr (requires { field.size(); })
      if constexpr (std::is_same_v<typename F::value_type, char>)
        std::fill(std::find(field.begin(), field.end(), '\0'), field.end(), '\0');
  });
}
#endif

// Table, version 2 bytes and version 1 bytes of every message against the tables of mavlink-mappings.
TEST(MavlinkPeer, EveryMessageIsTheSameByteForByte) {
#ifndef OVERFLY_NODE
  GTEST_SKIP() << "node-mavlink could not be installed";
#else
  constexpr int kEach = 40;
  NodeProgram node({OVERFLY_SOURCE_DIR "/tests/integration/mavlink/encode.js"});
  std::vector<Json> asked;
  std::vector<std::string> ours;
  std::vector<std::vector<std::uint8_t> > payloads;
  std::vector<const MessageInfo*> infos;
  std::mt19937_64 random(19);
  forEachMessage([&]<class M>(std::type_identity<M>) {
    for (int i = 0; i < kEach; ++i) {
      M message = randomMessage<M>(random);
      endTexts(message);
      const auto sequence = static_cast<std::uint8_t>(random());
      asked.push_back({{"id", M::kId},
                       {"system", 7},
                       {"component", 100},
                       {"sequence", sequence},
                       {"fields", fieldsOf(message)}});
      ours.push_back(hexOf(encode(message, {7, 100}, sequence)));
      payloads.push_back(payloadOf(message));
      infos.push_back(findMessage(M::kId));
    }
  });
  std::thread writer([&] {
    for (const Json& line : asked) node.write(line.dump());
    node.closeInput();
  });
  for (std::size_t i = 0; i < asked.size(); ++i) {
    const Json theirs = Json::parse(node.read(), nullptr, false);
    if (theirs.is_discarded()) {
      ADD_FAILURE() << "node gave no answer to " << asked[i].dump();
      break;
    }
    EXPECT_EQ(theirs["length"], infos[i]->length) << infos[i]->name;
    EXPECT_EQ(theirs["magic"], infos[i]->crc_extra) << infos[i]->name;
    EXPECT_EQ(theirs["names"].size(), asked[i]["fields"].size()) << infos[i]->name;
    // Nothing but zeros: the first byte stays (mavlink.io, "Payload Truncation"), and the peer cuts it too.
    const bool zeros = std::count(payloads[i].begin(), payloads[i].end(), 0) ==
                       static_cast<std::ptrdiff_t>(payloads[i].size());
    if (!zeros) {
      EXPECT_EQ(theirs["v2"], ours[i]) << infos[i]->name << " " << asked[i].dump();
    }
    // Version 1 carries the base fields; the peer adds the extensions.
    Parser parser;
    int count = 0;
    auto v1 = fromHex(theirs["v1"].get<std::string>());
    parser.feed(v1, [&](const Packet& packet, std::span<const std::uint8_t>) {
      ++count;
      EXPECT_EQ(packet.version, 1);
      EXPECT_TRUE(std::equal(packet.payload.begin(), packet.payload.begin() + infos[i]->base_length,
                             payloads[i].begin()))
          << infos[i]->name;
    });
    // Its messages have one byte of number.
    EXPECT_EQ(count, infos[i]->id < 256 ? 1 : 0) << infos[i]->name << " " << theirs["v1"];
  }
  writer.join();
#endif
}

}  // namespace
}  // namespace overfly::mavlink
