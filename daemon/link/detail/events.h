#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "daemon/link/detail/http_server.h"

namespace overfly::link {

// What happened, as Server-Sent Events for all streams: a ring of the latest, so that a slow client costs no
// memory. One that falls out of the ring is told to ask /changes instead. Thread-safe.
class EventHub {
 public:
  explicit EventHub(std::size_t ring_bytes = 1u << 20) : ring_bytes_(ring_bytes) {}

  enum class Kind { Change, Status, Beat };
  // `id`: what a client sends back as Last-Event-ID; empty for events that cannot be gone on from.
  void publish(Kind kind, const std::string& event, const std::string& id, const std::string& data);
  void beat();  // a comment line that keeps the connection alive

  // A stream that begins with `first` and goes on with what is published from now on.
  [[nodiscard]] std::shared_ptr<ResponseStream> subscribe(std::string first, bool with_status);
  // As subscribe(), but the position is taken before `first` is made, so that nothing falls between.
  struct Position {
    std::uint64_t sequence = 0;
  };
  [[nodiscard]] Position position() const;
  [[nodiscard]] std::shared_ptr<ResponseStream> subscribe(std::string first, bool with_status, Position from);
  [[nodiscard]] bool statusWanted() const;

  [[nodiscard]] static std::string format(const std::string& event, const std::string& id,
                                          const std::string& data);

 private:
  class Stream;
  struct Entry {
    std::uint64_t sequence;
    Kind kind;
    std::string text;
  };
  mutable std::mutex mutex_;
  std::deque<Entry> ring_;
  std::size_t used_bytes_ = 0;
  const std::size_t ring_bytes_;
  std::uint64_t next_ = 1;  // sequence of the next entry
  int status_streams_ = 0;
};

}  // namespace overfly::link
