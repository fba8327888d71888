#pragma once
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <thread>
#include <vector>

#include "config/error.h"
#include "tiling/store/map_store.h"
#include "tiling/store/tile_cache.h"

namespace overfly::tiling {

// Reads and decodes tiles on threads of its own, through the cache; requests for a tile that is being read
// already wait for that one read. The last request is served first: what was asked for last is what somebody
// looks at now. Thread-safe.
class TileLoader {
 public:
  using Done = std::function<void(const Result<TilePtr>&)>;

  // `open` makes a reader per thread (MapStore::reader). Unavailable tiles are passed on as errors.
  TileLoader(std::function<Result<MapReader>()> open, TileCache& cache, int threads = 1);
  // Requests that were not begun end with Unavailable.
  ~TileLoader();
  TileLoader(const TileLoader&) = delete;
  TileLoader& operator=(const TileLoader&) = delete;

  // `done` is called once: here and now when the tile is in the cache, otherwise on a thread of the loader.
  void load(const geo::TileKey& key, Done done);

 private:
  void run(const std::stop_token& stop);

  std::function<Result<MapReader>()> open_;
  TileCache& cache_;
  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::deque<geo::TileKey> order_;                     // not begun; the back is next
  std::map<geo::TileKey, std::vector<Done>> pending_;  // asked for and not done
  std::vector<std::jthread> threads_;                  // last: they use everything above
};

}  // namespace overfly::tiling
