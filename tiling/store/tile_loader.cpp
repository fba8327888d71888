#include "tiling/store/tile_loader.h"

#include <pthread.h>

#include <optional>
#include <utility>

#include "tiling/store/tile_codec.h"

namespace overfly::tiling {

TileLoader::TileLoader(std::function<Result<MapReader>()> open, TileCache& cache, int threads)
    : open_(std::move(open)), cache_(cache) {
  for (int i = 0; i < threads; ++i) {
    threads_.emplace_back([this](const std::stop_token& stop) { run(stop); });
    pthread_setname_np(threads_.back().native_handle(), "tile-loader");
  }
}

TileLoader::~TileLoader() {
  for (std::jthread& thread : threads_) thread.request_stop();
  threads_.clear();
  const Result<TilePtr> ended =
      fail(ErrorCode::Unavailable, "the tile was not read any more: the map closes");
  for (const auto& [key, waiting] : pending_)
    for (const Done& done : waiting) done(ended);
}

void TileLoader::load(const geo::TileKey& key, Done done) {
  if (const TilePtr tile = cache_.find(key)) {
    done(tile);
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    const auto [at, fresh] = pending_.try_emplace(key);
    at->second.push_back(std::move(done));
    if (!fresh) return;
    order_.push_back(key);
  }
  wake_.notify_one();
}

void TileLoader::run(const std::stop_token& stop) {
  std::optional<MapReader> reader;
  for (;;) {
    geo::TileKey key;
    {
      std::unique_lock lock(mutex_);
      if (!wake_.wait(lock, stop, [this] { return !order_.empty(); }) || stop.stop_requested()) return;
      key = order_.back();
      order_.pop_back();
    }
    Result<TilePtr> result = fail(ErrorCode::Unavailable, "the map cannot be opened");
    if (!reader) {
      Result<MapReader> opened = open_();
      if (opened)
        reader = std::move(*opened);
      else
        result = tl::unexpected(opened.error());
    }
    if (reader) {
      const std::uint64_t ticket = cache_.ticket();
      Result<Tile> tile = readTile(*reader, key);
      if (tile) {
        result = std::make_shared<const Tile>(std::move(*tile));
        cache_.insert(*result, ticket);
      } else {
        result = tl::unexpected(tile.error());
      }
    }
    std::vector<Done> waiting;
    {
      const std::lock_guard lock(mutex_);
      const auto at = pending_.find(key);
      waiting = std::move(at->second);
      pending_.erase(at);
    }
    for (const Done& done : waiting) done(result);
  }
}

}  // namespace overfly::tiling
