#pragma once
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <mutex>

#include "tiling/tile.h"

namespace overfly::tiling {

using TilePtr = std::shared_ptr<const Tile>;

// Decoded tiles in RAM, the least recently used thrown out when the byte budget is passed. Thread-safe.
// What it holds is never older than the store: the writer's listener calls invalidate(), and a tile that was
// read before an invalidation is not taken in after it (see ticket()).
class TileCache {
 public:
  explicit TileCache(std::size_t budget_bytes) : budget_(budget_bytes) {}

  struct Counts {
    std::uint64_t hits = 0, misses = 0, evictions = 0, invalidations = 0;
    std::size_t tiles = 0, bytes = 0;
  };

  // Null when it is not here.
  [[nodiscard]] TilePtr find(const geo::TileKey& key);

  // Take a ticket before reading from the store and hand it in with what was read.
  [[nodiscard]] std::uint64_t ticket() const;
  // Does nothing when the tile was invalidated since the ticket, or is larger than the whole budget.
  void insert(const TilePtr& tile, std::uint64_t ticket);
  void invalidate(const geo::TileKey& key);
  void clear();

  [[nodiscard]] Counts counts() const;
  [[nodiscard]] static std::size_t bytesOf(const Tile& tile);

 private:
  struct Entry {
    TilePtr tile;
    std::size_t bytes = 0;
    std::list<geo::TileKey>::iterator place;
  };
  void remove(std::map<geo::TileKey, Entry>::iterator at);

  const std::size_t budget_;
  mutable std::mutex mutex_;
  std::list<geo::TileKey> recent_;  // the front was used last
  std::map<geo::TileKey, Entry> entries_;
  // Tickets are times of a logical clock. Of invalidated keys the latest are remembered; a ticket from
  // before the oldest of them is too old to be judged, and refused.
  static constexpr std::size_t kRemembered = 4096;
  std::uint64_t clock_ = 1;
  std::uint64_t forgotten_ = 0;
  std::list<std::pair<std::uint64_t, geo::TileKey>> invalidated_;
  std::map<geo::TileKey, std::uint64_t> invalidated_at_;
  Counts counts_;
};

}  // namespace overfly::tiling
