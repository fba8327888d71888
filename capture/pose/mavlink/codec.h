#pragma once
#include <algorithm>
#include <array>
#include <bit>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <string_view>
#include <type_traits>
#include <vector>

#include "capture/pose/mavlink/messages.h"

// MAVLink packets as bytes. Facts from mavlink.io/en/guide/serialization.html and message_signing.html:
// framing of versions 1 and 2, CRC-16/MCRF4XX over the packet without its first byte and with the message's
// CRC_EXTRA at the end, payloads of version 2 without their trailing zeros.
namespace overfly::mavlink {

static_assert(std::endian::native == std::endian::little, "fields are copied as they lie in memory");

inline constexpr std::uint8_t kStart1 = 0xFE, kStart2 = 0xFD;
inline constexpr std::size_t kHeader1 = 6, kHeader2 = 10, kChecksum = 2, kSignature = 13;
inline constexpr std::size_t kMaxPayload = 255;
inline constexpr std::size_t kMaxPacket = kHeader2 + kMaxPayload + kChecksum + kSignature;
inline constexpr std::uint8_t kSignedFlag = 0x01;  // the only incompatibility flag that there is

// One step of CRC-16/MCRF4XX (start value 0xFFFF).
[[nodiscard]] constexpr std::uint16_t crcStep(std::uint16_t crc, std::uint8_t byte) {
  auto t = static_cast<std::uint8_t>(byte ^ (crc & 0xFF));
  t = static_cast<std::uint8_t>(t ^ (t << 4));
  return static_cast<std::uint16_t>((crc >> 8) ^ (t << 8) ^ (t << 3) ^ (t >> 4));
}

struct MessageInfo {
  std::uint32_t id = 0;
  std::string_view name;
  std::uint8_t crc_extra = 0;
  std::uint8_t base_length = 0;  // bytes without extensions: the payload of version 1
  std::uint8_t length = 0;       // with them
};

// nullptr: not one of messages.h.
[[nodiscard]] const MessageInfo* findMessage(std::uint32_t id);
[[nodiscard]] std::span<const MessageInfo> allMessages();

// Who sends.
struct Address {
  std::uint8_t system = 0;
  std::uint8_t component = 0;
  friend auto operator<=>(const Address&, const Address&) = default;
};

// A packet whose checksum was right.
struct Packet {
  const MessageInfo* info = nullptr;  // never null in what a parser hands on
  int version = 2;
  std::uint8_t sequence = 0;
  Address from;
  std::array<std::uint8_t, kMaxPayload> payload{};  // zeros where the packet was shorter
  std::size_t length = 0;                           // of the payload as sent
  bool has_signature = false;
};

// Packet to message. The message must be the packet's: decode<M>(p) needs p.info->id == M::kId.
template <class M>
[[nodiscard]] M decode(const Packet& packet) {
  M message;
  std::size_t at = 0;
  M::fields(message, [&](std::string_view, auto& field) {
    std::memcpy(&field, packet.payload.data() + at, sizeof(field));
    at += sizeof(field);
  });
  return message;
}

// The whole payload with extensions, trailing zeros included.
template <class M>
[[nodiscard]] std::vector<std::uint8_t> payloadOf(const M& message) {
  std::vector<std::uint8_t> payload;
  M::fields(message, [&](std::string_view, const auto& field) {
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(&field);
    payload.insert(payload.end(), bytes, bytes + sizeof(field));
  });
  return payload;
}

// A version 2 packet around a whole payload, which is cut after its last byte that is not zero (but the first
// byte stays). `with_signature` sets the flag; the signature itself is Signer's.
[[nodiscard]] std::vector<std::uint8_t> packetOf(const MessageInfo& info,
                                                 std::span<const std::uint8_t> payload, Address from,
                                                 std::uint8_t sequence, bool with_signature);

template <class M>
[[nodiscard]] std::vector<std::uint8_t> encode(const M& message, Address from, std::uint8_t sequence,
                                               bool with_signature = false) {
  return packetOf(*findMessage(M::kId), payloadOf(message), from, sequence, with_signature);
}

// Text into a fixed array, cut where it is too long.
template <class T, std::size_t N>
void setText(std::array<T, N>& to, std::string_view text) {
  to.fill(0);
  std::memcpy(to.data(), text.data(), std::min(text.size(), N));
}

}  // namespace overfly::mavlink
