#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace overfly::link {

// Limits bytes over time for all clients together. Not thread-safe: the server thread's own.
class TokenBucket {
 public:
  // bytes_per_s <= 0: no limit. Up to `burst_s` seconds' worth may be spent at once.
  explicit TokenBucket(double bytes_per_s, double burst_s = 0.25)
      : rate_(bytes_per_s), burst_(std::max(bytes_per_s * burst_s, 1500.0)), tokens_(burst_) {}

  // What has been saved up stays, as far as the new rate lets it.
  void setRate(double bytes_per_s, double burst_s = 0.25) {
    rate_ = bytes_per_s;
    burst_ = std::max(bytes_per_s * burst_s, 1500.0);
    tokens_ = unlimited() ? burst_ : std::min(tokens_, burst_);
  }

  [[nodiscard]] bool unlimited() const { return rate_ <= 0; }

  // How many of `wanted` bytes may be sent now; a grant below `least` is refused, so that a starved
  // connection does not trickle out in single bytes.
  [[nodiscard]] std::size_t take(std::size_t wanted, std::size_t least, std::int64_t now_ns) {
    if (unlimited()) return wanted;
    refill(now_ns);
    const auto granted = std::min(wanted, static_cast<std::size_t>(std::max(tokens_, 0.0)));
    if (granted < std::min(wanted, least)) return 0;
    tokens_ -= static_cast<double>(granted);
    return granted;
  }

  // Bytes that were sent anyway (response headers); the balance may go below zero.
  void charge(std::size_t bytes, std::int64_t now_ns) {
    if (unlimited()) return;
    refill(now_ns);
    tokens_ -= static_cast<double>(bytes);
  }

  // Granted, but not used.
  void refund(std::size_t bytes) { tokens_ += static_cast<double>(bytes); }

  [[nodiscard]] double available(std::int64_t now_ns) {
    refill(now_ns);
    return tokens_;
  }

 private:
  void refill(std::int64_t now_ns) {
    if (last_ns_ != 0)
      tokens_ = std::min(burst_, tokens_ + rate_ * 1e-9 * static_cast<double>(now_ns - last_ns_));
    last_ns_ = now_ns;
  }
  double rate_, burst_, tokens_;
  std::int64_t last_ns_ = 0;
};

}  // namespace overfly::link
