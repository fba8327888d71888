#include "tiling/store/store_writer.h"

#include <pthread.h>

#include <algorithm>
#include <utility>

namespace overfly::tiling {
namespace {

std::size_t layerBytes(const Batch& batch) {
  std::size_t bytes = 0;
  for (const TileWrite& tile : batch.tiles)
    for (const EncodedLayer& layer : tile.layers) bytes += layer.bytes.size();
  return bytes;
}

// What a batch holds in memory, roughly: enough to bound the queue.
std::size_t heldBytes(const Batch& batch) {
  return layerBytes(batch) + batch.tiles.size() * sizeof(TileWrite) +
         batch.frames.size() * sizeof(FrameRecord) +
         (batch.enqueue.size() + batch.dequeue.size()) * sizeof(QueueEntry) + sizeof(Batch);
}

template <typename T>
void append(std::vector<T>& to, const std::vector<T>& from) {
  to.insert(to.end(), from.begin(), from.end());
}

bool diskRefused(const Error& error) {
  return error.code == ErrorCode::Io || error.code == ErrorCode::Unavailable;
}

}  // namespace

StoreWriter::StoreWriter(MapStore store, const Options& options)
    : options_(options),
      store_(std::move(store)),
      thread_([this](const std::stop_token& stop) { run(stop); }) {
  pthread_setname_np(thread_.native_handle(), "store-writer");
}

StoreWriter::~StoreWriter() {
  thread_.request_stop();
  thread_.join();
}

Result<std::future<Result<std::uint64_t>>> StoreWriter::submit(Batch&& batch) {
  const std::size_t bytes = heldBytes(batch);
  std::future<Result<std::uint64_t>> future;
  {
    const std::lock_guard lock(mutex_);
    if (status_.waiting_bytes > 0 && status_.waiting_bytes + bytes > options_.queue_bytes) {
      ++status_.refused_batches;
      return fail(ErrorCode::Unavailable, status_.degraded
                                              ? "the map cannot be written: " + status_.reason
                                              : "the disk is slower than the map grows; tiles wait");
    }
    Waiting& waiting = queue_.emplace_back();
    waiting.batch = std::move(batch);
    waiting.bytes = bytes;
    status_.waiting_bytes += bytes;
    ++status_.waiting_batches;
    future = waiting.done.get_future();
  }
  wake_.notify_one();
  return future;
}

bool StoreWriter::flush(std::chrono::milliseconds timeout) {
  std::unique_lock lock(mutex_);
  return idle_.wait_for(lock, timeout, [this] { return queue_.empty() && in_work_ == 0; });
}

StoreWriter::Status StoreWriter::status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

void StoreWriter::run(const std::stop_token& stop) {
  auto retry = options_.first_retry;
  for (;;) {
    std::deque<Waiting> group;
    {
      std::unique_lock lock(mutex_);
      wake_.wait(lock, stop, [this] { return !queue_.empty(); });
      if (queue_.empty()) return;  // stopped, and nothing waits
      group = takeGroup();
    }
    while (!commitGroup(group)) {
      if (stop.stop_requested()) {
        const Error error{ErrorCode::Io, status().reason};
        for (Waiting& waiting : group) finish(waiting, tl::unexpected(error));
        break;
      }
      std::unique_lock lock(mutex_);
      wake_.wait_for(lock, stop, retry, [] { return false; });
      retry = std::min(2 * retry, options_.last_retry);
    }
    retry = options_.first_retry;
    {
      const std::lock_guard lock(mutex_);
      in_work_ = 0;
    }
    idle_.notify_all();
  }
}

std::deque<StoreWriter::Waiting> StoreWriter::takeGroup() {
  std::deque<Waiting> group;
  std::size_t bytes = 0;
  while (!queue_.empty() && (group.empty() || bytes + queue_.front().bytes <= options_.group_bytes)) {
    bytes += queue_.front().bytes;
    group.push_back(std::move(queue_.front()));
    queue_.pop_front();
  }
  in_work_ = group.size();
  return group;
}

bool StoreWriter::commitGroup(std::deque<Waiting>& group) {
  Result<std::uint64_t> result = 0;
  if (group.size() == 1) {
    result = store_.commit(group.front().batch);
  } else {
    // Within one transaction the order of tiles, then removals, then additions would mix the batches' queue
    // entries; a work item that one batch adds and a later one removes has to end removed.
    Batch joined;
    for (const Waiting& waiting : group) {
      append(joined.tiles, waiting.batch.tiles);
      append(joined.frames, waiting.batch.frames);
      append(joined.values, waiting.batch.values);
      for (const auto& [key, kind] : waiting.batch.dequeue) {
        std::erase_if(joined.enqueue, [&, k = key, n = kind](const QueueEntry& entry) {
          return entry.key == k && entry.kind == n;
        });
        joined.dequeue.emplace_back(key, kind);
      }
      append(joined.enqueue, waiting.batch.enqueue);
    }
    result = store_.commit(joined);
  }
  if (!result && diskRefused(result.error())) {
    const std::lock_guard lock(mutex_);
    status_.degraded = true;
    status_.reason = result.error().message;
    ++status_.failed_commits;
    return false;
  }
  {
    const std::lock_guard lock(mutex_);
    status_.degraded = false;
    status_.reason.clear();
    ++status_.commits;
  }
  if (!result && group.size() > 1) {
    commitEach(group);  // one of them is bad: find it
    return group.empty();
  }
  for (Waiting& waiting : group) finish(waiting, result);
  group.clear();
  return true;
}

void StoreWriter::commitEach(std::deque<Waiting>& group) {
  while (!group.empty()) {
    const Result<std::uint64_t> result = store_.commit(group.front().batch);
    if (!result && diskRefused(result.error())) return;
    finish(group.front(), result);
    group.pop_front();
  }
}

void StoreWriter::finish(Waiting& waiting, const Result<std::uint64_t>& result) {
  {
    const std::lock_guard lock(mutex_);
    status_.waiting_bytes -= waiting.bytes;
    --status_.waiting_batches;
    if (result) {
      ++status_.batches;
      status_.tiles += waiting.batch.tiles.size();
      status_.layer_bytes += layerBytes(waiting.batch);
    }
  }
  waiting.done.set_value(result);
}

}  // namespace overfly::tiling
