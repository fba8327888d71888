#pragma once
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/pull/want_list.h"

namespace overfly::pull {

// A record of which the beginning is here.
struct Begun {
  LayerKey what;
  std::uint64_t revision = 0;
  std::string bytes;  // more than its head
};

// Whole records out of the bytes of one /bundle?tiles= answer, in whatever portions they come. Some of the
// tiles may have been asked for from their middle (`begun`, in the order asked): the answer goes on where
// those end, or, where a tile has changed, brings it whole. One thread.
class RecordStream {
 public:
  explicit RecordStream(std::deque<Begun> begun = {}) : begun_(std::move(begun)) {}

  // The records that are whole now. BadInput: what comes is not a bundle.
  [[nodiscard]] Result<std::vector<link::TileRecord>> feed(std::string_view bytes);
  // When the answer broke off: everything that is here in part, to go on from later.
  [[nodiscard]] std::vector<Begun> parts() const;
  // Bytes that were here before and did not have to come again.
  [[nodiscard]] std::uint64_t resumed() const { return resumed_; }

 private:
  [[nodiscard]] bool atRecord();

  std::deque<Begun> begun_;
  std::string rest_;
  bool inside_ = false;  // rest_ begins with the record's own first byte
  std::uint64_t resumed_ = 0;
};

}  // namespace overfly::pull
