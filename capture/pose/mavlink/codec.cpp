#include "capture/pose/mavlink/codec.h"

namespace overfly::mavlink {
namespace {

template <class T>
consteval std::string_view wireName() {
  if constexpr (std::is_same_v<T, char>) return "char";
  if constexpr (std::is_same_v<T, float>) return "float";
  if constexpr (std::is_same_v<T, std::uint8_t>) return "uint8_t";
  if constexpr (std::is_same_v<T, std::int8_t>) return "int8_t";
  if constexpr (std::is_same_v<T, std::uint16_t>) return "uint16_t";
  if constexpr (std::is_same_v<T, std::int16_t>) return "int16_t";
  if constexpr (std::is_same_v<T, std::uint32_t>) return "uint32_t";
  if constexpr (std::is_same_v<T, std::int32_t>) return "int32_t";
  if constexpr (std::is_same_v<T, std::uint64_t>) return "uint64_t";
  if constexpr (std::is_same_v<T, std::int64_t>) return "int64_t";
}

template <class T>
struct Wire {
  using Element = T;
  static constexpr std::size_t kCount = 0;  // no array
};
template <class T, std::size_t N>
struct Wire<std::array<T, N>> {
  using Element = T;
  static constexpr std::size_t kCount = N;
};

// CRC_EXTRA: the checksum of the message's name and its base fields' types, names and array lengths, folded
// into a byte (mavlink.io, "CRC_EXTRA calculation").
template <class M>
consteval MessageInfo describe() {
  MessageInfo info{M::kId, M::kName, 0, 0, 0};
  std::uint16_t crc = 0xFFFF;
  const auto add = [&crc](std::string_view text) {
    for (const char c : text) crc = crcStep(crc, static_cast<std::uint8_t>(c));
    crc = crcStep(crc, ' ');
  };
  add(M::kName);
  int seen = 0;
  const M message;
  M::fields(message, [&]<class F>(std::string_view name, const F&) {
    if (seen++ < M::kBaseFields) {
      add(wireName<typename Wire<F>::Element>());
      add(name);
      if (Wire<F>::kCount > 0) crc = crcStep(crc, static_cast<std::uint8_t>(Wire<F>::kCount));
      info.base_length = static_cast<std::uint8_t>(info.base_length + sizeof(F));
    }
    info.length = static_cast<std::uint8_t>(info.length + sizeof(F));
  });
  info.crc_extra = static_cast<std::uint8_t>((crc & 0xFF) ^ (crc >> 8));
  return info;
}

template <class... M>
consteval std::array<MessageInfo, sizeof...(M)> describeAll(std::type_identity<std::tuple<M...>>) {
  return {describe<M>()...};
}

constexpr auto kMessages = describeAll(std::type_identity<Messages>{});
static_assert(std::is_sorted(kMessages.begin(), kMessages.end(),
                             [](const MessageInfo& a, const MessageInfo& b) { return a.id < b.id; }));

}  // namespace

std::span<const MessageInfo> allMessages() { return kMessages; }

const MessageInfo* findMessage(std::uint32_t id) {
  const auto* found =
      std::lower_bound(kMessages.begin(), kMessages.end(), id,
                       [](const MessageInfo& info, std::uint32_t wanted) { return info.id < wanted; });
  return found != kMessages.end() && found->id == id ? found : nullptr;
}

std::vector<std::uint8_t> packetOf(const MessageInfo& info, std::span<const std::uint8_t> payload,
                                   Address from, std::uint8_t sequence, bool with_signature) {
  std::size_t length = payload.size();
  while (length > 1 && payload[length - 1] == 0) --length;
  const std::uint8_t header[kHeader2] = {kStart2,
                                         static_cast<std::uint8_t>(length),
                                         with_signature ? kSignedFlag : std::uint8_t{0},
                                         0,
                                         sequence,
                                         from.system,
                                         from.component,
                                         static_cast<std::uint8_t>(info.id),
                                         static_cast<std::uint8_t>(info.id >> 8),
                                         static_cast<std::uint8_t>(info.id >> 16)};
  std::vector<std::uint8_t> packet;
  packet.reserve(kMaxPacket);
  packet.insert(packet.end(), std::begin(header), std::end(header));
  packet.insert(packet.end(), payload.begin(), payload.begin() + static_cast<std::ptrdiff_t>(length));
  std::uint16_t crc = 0xFFFF;
  for (std::size_t i = 1; i < packet.size(); ++i) crc = crcStep(crc, packet[i]);
  crc = crcStep(crc, info.crc_extra);
  packet.push_back(static_cast<std::uint8_t>(crc));
  packet.push_back(static_cast<std::uint8_t>(crc >> 8));
  return packet;
}

}  // namespace overfly::mavlink
