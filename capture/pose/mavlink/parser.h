#pragma once
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "capture/pose/mavlink/codec.h"

namespace overfly::mavlink {

struct ParserCounts {
  std::uint64_t packets = 0;  // handed on
  std::uint64_t unknown = 0;  // where a packet was due: of a message that we do not speak
  std::uint64_t bad = 0;      // of a known message, wrong checksum or length
  std::uint64_t skipped = 0;  // bytes that belong to no packet
  std::uint64_t lost = 0;     // gaps in senders' sequence numbers
  friend bool operator==(const ParserCounts&, const ParserCounts&) = default;
};

// Finds packets in a stream of bytes that comes in pieces of any size. Only a right checksum makes a packet;
// after a damaged one the search goes on one byte behind its start, so that the next whole packet is found
// whatever stands between. Holds at most one packet's bytes. Thread-bound.
class Parser {
 public:
  // `raw`: the packet's bytes, start byte to checksum or signature.
  using Handler = std::function<void(const Packet& packet, std::span<const std::uint8_t> raw)>;

  void feed(std::span<const std::uint8_t> bytes, const Handler& handler);
  [[nodiscard]] const ParserCounts& counts() const { return counts_; }
  // Forgets half a packet: the link began anew.
  void reset() {
    pending_.clear();
    unknown_left_ = 0;
    aligned_ = true;
  }

 private:
  // Bytes consumed at the front of `bytes`; 0: more are needed.
  std::size_t step(std::span<const std::uint8_t> bytes, const Handler& handler);
  void countLost(Address from, std::uint8_t sequence);

  std::vector<std::uint8_t> pending_;
  std::size_t unknown_left_ = 0;  // bytes of a message that we do not speak, still to come
  bool aligned_ = true;           // what comes next is where a packet should begin
  ParserCounts counts_;
  struct Seen {
    Address from;
    std::uint8_t sequence;
  };
  std::vector<Seen> seen_;
};

}  // namespace overfly::mavlink
