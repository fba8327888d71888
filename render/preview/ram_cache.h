#pragma once
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "render/preview/tile_source.h"

namespace overfly::preview {

using Clock = std::chrono::steady_clock;

// The second cache level (DVT, 3.3): decoded tiles in RAM, shared by any number of views.
//
//   1. A tile in region A or B of any view is never thrown out; the others wait in the order of their last
//   use,
//      the least recently used goes first when the byte budget is passed.
//   2. A tile that changed or outlived its life is loaded anew while the old one stays in use (soft expiry);
//      beyond its grace it is no longer handed out (hard expiry).
//   3. A tile that the source does not have is marked absent and not asked for again until the mark has
//      outlived `absent_life`, or the source reports it changed. A tile that could not be read is delayed and
//      tried again after `retry`, at most `max_delays` times; then it counts as absent.
//
// Thread rule: every call may come from any thread.
class RamCache {
 public:
  struct Options {
    std::size_t budget_bytes = 128u << 20;
    std::chrono::nanoseconds absent_life = std::chrono::seconds(5);
    std::chrono::nanoseconds retry = std::chrono::milliseconds(200);
    int max_delays = 5;
  };
  enum class State { Unknown, Present, Delayed, Absent };
  struct Found {
    State state = State::Unknown;
    SourceTilePtr tile;            // while Present
    std::uint64_t generation = 0;  // grows with every load of the tile; 0: never loaded
  };
  struct Counts {
    std::size_t tiles = 0, bytes = 0, referenced = 0;
    std::uint64_t loads = 0, failures = 0, evictions = 0, absent = 0;
  };

  // The source outlives the cache.
  RamCache(TileSource& source, const Options& options);
  explicit RamCache(TileSource& source) : RamCache(source, Options{}) {}
  ~RamCache();
  RamCache(const RamCache&) = delete;
  RamCache& operator=(const RamCache&) = delete;

  using Client = int;
  [[nodiscard]] Client addClient();
  void removeClient(Client client);
  // What a view needs, most urgent first: regions A and B as `needed`, region C as `prefetch`. Replaces what
  // it asked for before.
  void want(Client client, std::vector<geo::TileKey> needed, std::vector<geo::TileKey> prefetch);

  [[nodiscard]] Found find(const geo::TileKey& key, Clock::time_point now = Clock::now());

  // Loads the one tile that is most urgent; false: there is nothing to load now.
  bool loadNext(Clock::time_point now = Clock::now());
  // Loads what is wanted and due as of now, on this thread, each tile once: it ends also where tiles outlive
  // their life, or change, faster than they can be read.
  void loadDue();
  // Asks the source what changed. Its error is passed on; nothing is lost then.
  Result<void> poll();
  // Loads by itself, on a thread of its own, from now on; polls at this interval.
  void startLoading(std::chrono::milliseconds poll_interval);

  [[nodiscard]] Counts counts() const;
  [[nodiscard]] TileSource& source() { return source_; }
  [[nodiscard]] static std::size_t bytesOf(const SourceTile& tile);

 private:
  struct Entry {
    State state = State::Unknown;
    SourceTilePtr tile;
    std::uint64_t generation = 0;
    bool changed = false;  // the source has a newer one
    bool loading = false;
    int delays = 0;
    int references = 0;            // views that have it in A or B
    Clock::time_point soft, hard;  // expiry of what is there; for Delayed and Absent: when to ask again
    std::list<geo::TileKey>::iterator place;
    std::size_t bytes = 0;
  };
  struct Wants {
    std::vector<geo::TileKey> needed, prefetch;
  };
  [[nodiscard]] bool due(const Entry& entry, Clock::time_point now) const;
  // Marked as being loaded.
  [[nodiscard]] std::optional<geo::TileKey> take(Clock::time_point now);
  [[nodiscard]] std::optional<geo::TileKey> choose(Clock::time_point now);
  void load(const geo::TileKey& key, const std::optional<Clock::time_point>& now);
  void store(const geo::TileKey& key, const Result<SourceTilePtr>& loaded, Clock::time_point now);
  Entry& entryOf(const geo::TileKey& key);
  void makeRoom();
  void serve(const std::stop_token& stop, std::chrono::milliseconds poll_interval);

  TileSource& source_;
  const Options options_;
  mutable std::mutex mutex_;
  std::map<geo::TileKey, Entry> entries_;
  std::list<geo::TileKey> recent_;  // the front was used last
  std::map<Client, Wants> clients_;
  Client next_client_ = 1;
  std::uint64_t revision_ = 0;  // of the source, as of the last poll
  std::uint64_t generation_ = 0;
  std::size_t bytes_ = 0;
  Counts counts_;
  bool woken_ = false;  // something new to load since the loading thread last looked
  std::condition_variable_any wake_;
  std::jthread thread_;  // last: uses everything above
};

}  // namespace overfly::preview
