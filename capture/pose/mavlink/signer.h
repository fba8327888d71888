#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <vector>

#include "capture/pose/mavlink/codec.h"
#include "config/error.h"

namespace overfly::mavlink {

using Key = std::array<std::uint8_t, 32>;

// A file of 32 bytes, or of 64 hexadecimal digits (white space around them is let pass). NotFound, Io;
// BadSettings: anything else.
[[nodiscard]] Result<Key> readKey(const std::filesystem::path& file);

// Message signing (mavlink.io/en/guide/message_signing.html): 1 byte link, 6 bytes time in 10 us since
// 2015-01-01 UTC, the first 6 bytes of SHA-256(key, packet with checksum, link, time). Thread-bound.
class Signer {
 public:
  Signer(const Key& key, std::uint8_t link) : key_(key), link_(link) {}

  // Appends the signature to a packet that was encoded with_signature. `unix_us`: now; times go up by at
  // least one step whatever the clock does.
  void sign(std::vector<std::uint8_t>& packet, std::int64_t unix_us);

  enum class Verdict { Good, Unsigned, WrongKey, Replayed };
  // `raw`: as the parser hands it on. Replayed: not younger than the last good one of the same sender and
  // link, or, for the first of a stream, more than a minute older than the youngest of all.
  [[nodiscard]] Verdict verify(const Packet& packet, std::span<const std::uint8_t> raw);

 private:
  [[nodiscard]] std::array<std::uint8_t, 6> digest(std::span<const std::uint8_t> without_digest) const;

  struct Stream {
    Address from;
    std::uint8_t link = 0;
    friend auto operator<=>(const Stream&, const Stream&) = default;
  };
  Key key_;
  std::uint8_t link_;
  std::uint64_t time_ = 0;  // the youngest that was sent or accepted, 10 us
  std::map<Stream, std::uint64_t> last_;
};

}  // namespace overfly::mavlink
