#include "capture/pose/mavlink/parser.h"

#include <algorithm>

namespace overfly::mavlink {
namespace {

constexpr std::size_t kMaxSenders = 64;

struct Frame {
  std::uint32_t id = 0;
  std::size_t header = 0, payload = 0, total = 0;
};

// What a start byte and the bytes behind it claim. `total` 0: more bytes are needed to say; nullopt: no
// packet.
std::optional<Frame> frameAt(std::span<const std::uint8_t> bytes) {
  const bool second = bytes[0] == kStart2;
  Frame frame;
  frame.header = second ? kHeader2 : kHeader1;
  if (second && bytes.size() > 2 && (bytes[2] & ~kSignedFlag) != 0) return std::nullopt;
  if (bytes.size() < frame.header) return frame;
  frame.payload = bytes[1];
  frame.id = static_cast<std::uint32_t>(second ? bytes[7] | bytes[8] << 8 | bytes[9] << 16 : bytes[5]);
  frame.total =
      frame.header + frame.payload + kChecksum + (second && (bytes[2] & kSignedFlag) != 0 ? kSignature : 0);
  return frame;
}

bool checksumIsRight(std::span<const std::uint8_t> bytes, const Frame& frame, std::uint8_t crc_extra) {
  const std::size_t end = frame.header + frame.payload;
  std::uint16_t crc = 0xFFFF;
  for (std::size_t i = 1; i < end; ++i) crc = crcStep(crc, bytes[i]);
  crc = crcStep(crc, crc_extra);
  return bytes[end] == (crc & 0xFF) && bytes[end + 1] == (crc >> 8);
}

}  // namespace

void Parser::feed(std::span<const std::uint8_t> bytes, const Handler& handler) {
  pending_.insert(pending_.end(), bytes.begin(), bytes.end());
  std::size_t at = 0;
  while (at < pending_.size()) {
    const std::size_t used = step(std::span(pending_).subspan(at), handler);
    if (used == 0) break;
    at += used;
  }
  pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(at));
}

std::size_t Parser::step(std::span<const std::uint8_t> bytes, const Handler& handler) {
  const auto skip = [&](std::size_t count) {
    const std::size_t strange = std::min(count, unknown_left_);
    unknown_left_ -= strange;
    counts_.skipped += count - strange;
    aligned_ = strange == count && unknown_left_ == 0;
    return count;
  };
  if (bytes[0] != kStart1 && bytes[0] != kStart2) {
    const auto start =
        std::find_if(bytes.begin(), bytes.end(), [](std::uint8_t b) { return b == kStart1 || b == kStart2; });
    return skip(static_cast<std::size_t>(start - bytes.begin()));
  }
  const auto frame = frameAt(bytes);
  if (!frame) return skip(1);
  if (frame->total == 0) return 0;
  const MessageInfo* info = findMessage(frame->id);
  const bool second = bytes[0] == kStart2;
  if (info == nullptr) {
    // Its checksum cannot be looked at, so it is not believed: where a packet was due it counts as one that
    // we do not speak, and the search goes on within it all the same.
    if (aligned_ && unknown_left_ == 0) {
      ++counts_.unknown;
      countLost({bytes[second ? 5 : 3], bytes[second ? 6 : 4]}, bytes[second ? 4 : 2]);
      unknown_left_ = frame->total;
    }
    return skip(1);
  }
  // Version 1 sends the base fields, all of them; some senders add the extensions. Version 2 may come with
  // extensions that are newer than we are.
  if (!second && frame->payload != info->base_length && frame->payload != info->length) {
    if (aligned_) ++counts_.bad;
    return skip(1);
  }
  if (bytes.size() < frame->total) return 0;
  if (!checksumIsRight(bytes, *frame, info->crc_extra)) {
    if (aligned_) ++counts_.bad;
    return skip(1);
  }
  Packet packet;
  packet.info = info;
  packet.version = second ? 2 : 1;
  packet.sequence = bytes[second ? 4 : 2];
  packet.from = {bytes[second ? 5 : 3], bytes[second ? 6 : 4]};
  packet.length = frame->payload;
  packet.has_signature = second && (bytes[2] & kSignedFlag) != 0;
  std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(frame->header),
              std::min<std::size_t>(frame->payload, info->length), packet.payload.begin());
  aligned_ = true;
  unknown_left_ = 0;
  ++counts_.packets;
  countLost(packet.from, packet.sequence);
  handler(packet, bytes.first(frame->total));
  return frame->total;
}

void Parser::countLost(Address from, std::uint8_t sequence) {
  const auto known =
      std::find_if(seen_.begin(), seen_.end(), [&](const Seen& seen) { return seen.from == from; });
  if (known == seen_.end()) {
    if (seen_.size() < kMaxSenders) seen_.push_back({from, sequence});
    return;
  }
  // Half a turn and more is a sender that began anew, not a loss.
  const auto gap = static_cast<std::uint8_t>(sequence - known->sequence - 1);
  if (gap < 128) counts_.lost += gap;
  known->sequence = sequence;
}

}  // namespace overfly::mavlink
