#pragma once
#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include "daemon/pull/mirror.h"

namespace overfly::pull {

// Gathers what has come for a mirror into transactions: one for half a second's worth or a few megabytes.
// What the disk refuses stays here and is tried again. One thread.
class MirrorWriter {
 public:
  // What is gathered for the last mirror must have been committed, or is dropped.
  void open(std::unique_ptr<Mirror> mirror);
  void close();
  [[nodiscard]] bool isOpen() const { return mirror_ != nullptr; }
  [[nodiscard]] const Mirror& mirror() const { return *mirror_; }

  void keep(link::TileRecord record);
  // With the commit that comes next: all records up to it have been kept.
  void keepCursor(std::string cursor) { pending_.cursor = std::move(cursor); }
  [[nodiscard]] bool isEmpty() const { return pending_.records.empty(); }
  [[nodiscard]] bool isFull() const;  // nothing more should be fetched until the disk takes what there is

  // Time to commit: something is old or much, or `idle` and there is anything; not so soon after a failure.
  [[nodiscard]] bool isDue(bool idle) const;
  // True when there was something to write. Io: it was not written and is kept.
  [[nodiscard]] Result<bool> commit();

 private:
  using Clock = std::chrono::steady_clock;
  std::unique_ptr<Mirror> mirror_;
  MirrorBatch pending_;
  std::uint64_t pending_bytes_ = 0;
  Clock::time_point since_, retry_at_;
};

}  // namespace overfly::pull
