#pragma once
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <future>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>

#include "config/error.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling {

// The thread that writes a map, so that neither the GPU nor the link waits for the disk. Batches are
// committed in the order of their submission; those that wait while the disk is busy share one transaction,
// and so one sync (group commit).
//
// When the disk refuses (full, an I/O error) the writer is degraded: it keeps the batches it has, tries
// again at growing intervals, and goes on by itself when the disk lets it. Readers do not notice.
// Thread-safe, but for the constructor and destructor.
class StoreWriter {
 public:
  struct Options {
    std::size_t queue_bytes = 64u << 20;  // batches waiting; beyond it submit() refuses
    std::size_t group_bytes = 8u << 20;   // at most this much in one transaction (a larger batch goes alone)
    std::chrono::milliseconds first_retry{100};
    std::chrono::milliseconds last_retry{2000};
  };
  struct Status {
    bool degraded = false;
    std::string reason;  // one sentence, while degraded
    std::uint64_t batches = 0, tiles = 0, commits = 0, failed_commits = 0, refused_batches = 0;
    std::uint64_t layer_bytes = 0;  // encoded, committed
    std::size_t waiting_batches = 0, waiting_bytes = 0;
  };

  StoreWriter(MapStore store, const Options& options);
  // Commits what is waiting; gives up on what the disk refuses (those futures get the error).
  ~StoreWriter();
  StoreWriter(const StoreWriter&) = delete;
  StoreWriter& operator=(const StoreWriter&) = delete;

  // The future gets the revision when the batch is on the disk. Returns at once; Unavailable when the queue
  // is full (the caller keeps the batch, or drops it and lets its tiles be made again). BadInput comes
  // through the future: such a batch is dropped, the others of its group are committed.
  [[nodiscard]] Result<std::future<Result<std::uint64_t>>> submit(Batch&& batch);
  // Waits until everything submitted before is on the disk, or `timeout` has passed.
  [[nodiscard]] bool flush(std::chrono::milliseconds timeout);

  [[nodiscard]] Status status() const;
  // Of the store it owns; these may be called from any thread.
  int addListener(MapStore::Listener listener) { return store_.addListener(std::move(listener)); }
  void removeListener(int handle) { store_.removeListener(handle); }
  [[nodiscard]] Result<MapReader> reader() const { return store_.reader(); }
  [[nodiscard]] const MapMeta& meta() const { return store_.meta(); }

 private:
  struct Waiting {
    Batch batch;
    std::size_t bytes = 0;
    std::promise<Result<std::uint64_t>> done;
  };
  void run(const std::stop_token& stop);
  [[nodiscard]] std::deque<Waiting> takeGroup();
  // False: the disk refused, the group is as it was.
  [[nodiscard]] bool commitGroup(std::deque<Waiting>& group);
  void commitEach(std::deque<Waiting>& group);
  void finish(Waiting& waiting, const Result<std::uint64_t>& result);

  const Options options_;
  MapStore store_;
  mutable std::mutex mutex_;
  std::condition_variable_any wake_;
  std::condition_variable idle_;
  std::deque<Waiting> queue_;
  std::size_t in_work_ = 0;  // batches taken from the queue and not done
  Status status_;
  std::jthread thread_;  // last: it uses everything above
};

}  // namespace overfly::tiling
