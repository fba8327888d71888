#include "tiling/store/tile_cache.h"

namespace overfly::tiling {

std::size_t TileCache::bytesOf(const Tile& tile) {
  return sizeof(Tile) + tile.color.capacity() + tile.elevation.capacity() * sizeof(float) +
         tile.confidence.capacity() + tile.views.capacity() + tile.kind.capacity() +
         tile.source.capacity() * sizeof(std::uint16_t) + tile.gsd.capacity() + tile.angle.capacity() +
         tile.frame_set.capacity() * sizeof(std::uint64_t);
}

TilePtr TileCache::find(const geo::TileKey& key) {
  const std::lock_guard lock(mutex_);
  const auto at = entries_.find(key);
  if (at == entries_.end()) {
    ++counts_.misses;
    return nullptr;
  }
  ++counts_.hits;
  recent_.splice(recent_.begin(), recent_, at->second.place);
  return at->second.tile;
}

std::uint64_t TileCache::ticket() const {
  const std::lock_guard lock(mutex_);
  return clock_;
}

void TileCache::insert(const TilePtr& tile, std::uint64_t ticket) {
  const std::size_t bytes = bytesOf(*tile);
  const std::lock_guard lock(mutex_);
  if (bytes > budget_ || ticket < forgotten_) return;
  const auto outdated = invalidated_at_.find(tile->key);
  if (outdated != invalidated_at_.end() && outdated->second > ticket) return;
  if (const auto old = entries_.find(tile->key); old != entries_.end()) remove(old);
  while (counts_.bytes + bytes > budget_) {
    ++counts_.evictions;
    remove(entries_.find(recent_.back()));
  }
  recent_.push_front(tile->key);
  entries_.emplace(tile->key, Entry{tile, bytes, recent_.begin()});
  counts_.bytes += bytes;
}

void TileCache::invalidate(const geo::TileKey& key) {
  const std::lock_guard lock(mutex_);
  ++clock_;
  ++counts_.invalidations;
  invalidated_.emplace_back(clock_, key);
  invalidated_at_[key] = clock_;
  if (invalidated_.size() > kRemembered) {
    const auto& [when, which] = invalidated_.front();
    forgotten_ = when;
    if (const auto at = invalidated_at_.find(which); at->second == when) invalidated_at_.erase(at);
    invalidated_.pop_front();
  }
  if (const auto at = entries_.find(key); at != entries_.end()) remove(at);
}

void TileCache::clear() {
  const std::lock_guard lock(mutex_);
  entries_.clear();
  recent_.clear();
  counts_.bytes = 0;
  forgotten_ = ++clock_;
}

TileCache::Counts TileCache::counts() const {
  const std::lock_guard lock(mutex_);
  Counts counts = counts_;
  counts.tiles = entries_.size();
  return counts;
}

void TileCache::remove(std::map<geo::TileKey, Entry>::iterator at) {
  counts_.bytes -= at->second.bytes;
  recent_.erase(at->second.place);
  entries_.erase(at);
}

}  // namespace overfly::tiling
