#pragma once
#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "config/error.h"

namespace overfly::capture {

// A link that carries bytes both ways and may come and go: UDP, TCP or a serial line. Thread-bound.
class Transport {
 public:
  virtual ~Transport() = default;
  Transport() = default;
  Transport(const Transport&) = delete;
  Transport& operator=(const Transport&) = delete;

  // Unavailable: not there now, may come (the message says what to look at); Io: the system refuses
  // (permission, in use), which a person must mend, and is tried again all the same. An open link is closed
  // first.
  [[nodiscard]] virtual Result<void> open() = 0;
  // What has come, appended; nothing when `timeout` passed. Unavailable: the link is gone, open() it again.
  // `wake_fd` (or -1): a descriptor that ends the wait early when it becomes readable.
  [[nodiscard]] virtual Result<void> read(std::vector<std::uint8_t>& bytes, std::chrono::milliseconds timeout,
                                          int wake_fd) = 0;
  // One packet. Without a peer (UDP before anybody spoke) it is dropped.
  [[nodiscard]] virtual Result<void> write(std::span<const std::uint8_t> packet) = 0;
  virtual void close() = 0;

  [[nodiscard]] virtual const std::string& name() const = 0;
  // Packets let pass because they came from another address than the one that is being answered (UDP).
  [[nodiscard]] virtual std::uint64_t strangers() const { return 0; }
};

// "udp:[ADDRESS:]PORT" listens there and answers the first address that speaks, until it is silent for 5 s;
// "tcp:HOST:PORT" connects; "serial:DEVICE[:BAUD]" (57600 when not given). BadSettings.
[[nodiscard]] Result<std::unique_ptr<Transport>> makeTransport(std::string_view text);

}  // namespace overfly::capture
