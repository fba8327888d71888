#include "render/preview/ram_cache.h"

#include <algorithm>
#include <utility>

#include "config/niceness.h"

namespace overfly::preview {

RamCache::RamCache(TileSource& source, const Options& options) : source_(source), options_(options) {
  if (const auto extent = source.extent()) revision_ = extent->revision;
}

RamCache::~RamCache() {
  if (thread_.joinable()) {
    thread_.request_stop();
    wake_.notify_all();
  }
}

std::size_t RamCache::bytesOf(const SourceTile& tile) {
  return sizeof(SourceTile) + tile.color.size() + tile.confidence.size() +
         sizeof(float) * (tile.elevation.size() + tile.elevation_max.size());
}

RamCache::Client RamCache::addClient() {
  const std::scoped_lock lock(mutex_);
  clients_[next_client_];
  return next_client_++;
}

void RamCache::removeClient(Client client) {
  want(client, {}, {});
  const std::scoped_lock lock(mutex_);
  clients_.erase(client);
}

RamCache::Entry& RamCache::entryOf(const geo::TileKey& key) {
  const auto [at, added] = entries_.try_emplace(key);
  if (added) at->second.place = recent_.insert(recent_.begin(), key);
  return at->second;
}

void RamCache::want(Client client, std::vector<geo::TileKey> needed, std::vector<geo::TileKey> prefetch) {
  {
    const std::scoped_lock lock(mutex_);
    Wants& wants = clients_[client];
    for (const geo::TileKey& key : needed) ++entryOf(key).references;
    for (const geo::TileKey& key : wants.needed) --entryOf(key).references;
    wants = {std::move(needed), std::move(prefetch)};
    makeRoom();
    woken_ = true;
  }
  wake_.notify_all();
}

RamCache::Found RamCache::find(const geo::TileKey& key, Clock::time_point now) {
  const std::scoped_lock lock(mutex_);
  const auto at = entries_.find(key);
  if (at == entries_.end()) return {};
  Entry& entry = at->second;
  recent_.splice(recent_.begin(), recent_, entry.place);
  if (entry.state != State::Present) return {entry.state, nullptr, entry.generation};
  if (now >= entry.hard) return {State::Delayed, nullptr, entry.generation};
  return {State::Present, entry.tile, entry.generation};
}

bool RamCache::due(const Entry& entry, Clock::time_point now) const {
  if (entry.loading) return false;
  if (entry.state == State::Unknown) return true;
  return now >= entry.soft || (entry.changed && entry.state != State::Delayed);
}

std::optional<geo::TileKey> RamCache::choose(Clock::time_point now) {
  // The views in turn, each one's most urgent first; a view's prefetch only when nobody needs anything.
  std::size_t longest = 0;
  for (const auto& [id, wants] : clients_) longest = std::max(longest, wants.needed.size());
  for (std::size_t i = 0; i < longest; ++i)
    for (const auto& [id, wants] : clients_)
      if (i < wants.needed.size() && due(entryOf(wants.needed[i]), now)) return wants.needed[i];
  if (bytes_ >= options_.budget_bytes) return std::nullopt;
  for (const auto& [id, wants] : clients_)
    for (const geo::TileKey& key : wants.prefetch)
      if (due(entryOf(key), now)) return key;
  return std::nullopt;
}

std::optional<geo::TileKey> RamCache::take(Clock::time_point now) {
  const std::scoped_lock lock(mutex_);
  const auto chosen = choose(now);
  if (!chosen) return std::nullopt;
  Entry& entry = entryOf(*chosen);
  entry.loading = true;
  entry.changed = false;  // a change from here on is one more
  return chosen;
}

void RamCache::load(const geo::TileKey& key, const std::optional<Clock::time_point>& now) {
  const Result<SourceTilePtr> loaded = source_.load(key);
  const std::scoped_lock lock(mutex_);
  store(key, loaded, now ? *now : Clock::now());
}

bool RamCache::loadNext(Clock::time_point now) {
  const auto key = take(now);
  if (key) load(*key, now);
  return key.has_value();
}

void RamCache::loadDue() {
  const Clock::time_point begin = Clock::now();
  std::size_t most = 0;
  {
    const std::scoped_lock lock(mutex_);
    for (const auto& [id, wants] : clients_) most += wants.needed.size() + wants.prefetch.size();
  }
  for (; most > 0; --most) {
    const auto key = take(begin);
    if (!key) return;
    load(*key, std::nullopt);
  }
}

void RamCache::store(const geo::TileKey& key, const Result<SourceTilePtr>& loaded, Clock::time_point now) {
  Entry& entry = entryOf(key);
  entry.loading = false;
  ++counts_.loads;
  if (loaded) {
    bytes_ -= entry.bytes;
    entry.tile = *loaded;
    entry.bytes = bytesOf(**loaded);
    bytes_ += entry.bytes;
    entry.state = State::Present;
    entry.generation = ++generation_;
    entry.delays = 0;
    const bool mortal = (*loaded)->life.has_value();
    entry.soft = mortal ? now + *(*loaded)->life : Clock::time_point::max();
    entry.hard = mortal && (*loaded)->grace ? entry.soft + *(*loaded)->grace : Clock::time_point::max();
    makeRoom();
    return;
  }
  const bool gone = loaded.error().code == ErrorCode::NotFound;
  if (!gone) ++counts_.failures;
  if (!gone && (entry.state == State::Present || entry.delays < options_.max_delays)) {
    // What is there stays in use until its grace ends, however long the new one cannot be read.
    if (entry.state != State::Present) entry.state = State::Delayed;
    entry.soft = now + (++entry.delays <= options_.max_delays ? options_.retry : options_.absent_life);
    return;
  }
  bytes_ -= entry.bytes;
  entry.bytes = 0;
  entry.tile.reset();
  entry.state = State::Absent;
  entry.generation = ++generation_;
  entry.soft = now + options_.absent_life;
  ++counts_.absent;
}

void RamCache::makeRoom() {
  for (auto at = recent_.end(); bytes_ > options_.budget_bytes && at != recent_.begin();) {
    --at;
    const auto found = entries_.find(*at);
    const Entry& entry = found->second;
    if (entry.references > 0 || entry.loading || entry.bytes == 0) continue;
    bytes_ -= entry.bytes;
    ++counts_.evictions;
    entries_.erase(found);
    at = recent_.erase(at);
  }
  // Marks without a tile cost little, but not nothing: those beyond every view's wish go, the oldest first.
  constexpr std::size_t kMarks = 1 << 16;
  for (auto at = recent_.end(); entries_.size() > kMarks && at != recent_.begin();) {
    --at;
    const auto found = entries_.find(*at);
    if (found->second.references > 0 || found->second.loading || found->second.bytes > 0) continue;
    entries_.erase(found);
    at = recent_.erase(at);
  }
}

Result<void> RamCache::poll() {
  std::uint64_t since = 0;
  {
    const std::scoped_lock lock(mutex_);
    since = revision_;
  }
  const auto changed = source_.changes(since);
  if (!changed) return tl::unexpected(changed.error());
  bool any = false;
  {
    const std::scoped_lock lock(mutex_);
    revision_ = since;
    for (const geo::TileKey& key : *changed) {
      const auto at = entries_.find(key);
      if (at == entries_.end()) continue;
      at->second.changed = true;
      at->second.delays = 0;
      any = true;
    }
    woken_ = woken_ || any;
  }
  if (any) wake_.notify_all();
  return {};
}

void RamCache::startLoading(std::chrono::milliseconds poll_interval) {
  thread_ = std::jthread([this, poll_interval](const std::stop_token& stop) { serve(stop, poll_interval); });
}

void RamCache::serve(const std::stop_token& stop, std::chrono::milliseconds poll_interval) {
  standBack(kPreparingNiceness);
  Clock::time_point next_poll = Clock::now();
  while (!stop.stop_requested()) {
    if (Clock::now() >= next_poll) {
      static_cast<void>(poll());  // a source that cannot answer now is asked again
      next_poll = Clock::now() + poll_interval;
    }
    if (loadNext()) continue;
    std::unique_lock lock(mutex_);
    wake_.wait_until(lock, stop, std::min(next_poll, Clock::now() + std::chrono::milliseconds(100)),
                     [this] { return woken_; });
    woken_ = false;
  }
}

RamCache::Counts RamCache::counts() const {
  const std::scoped_lock lock(mutex_);
  Counts counts = counts_;
  counts.bytes = bytes_;
  for (const auto& [key, entry] : entries_) {
    if (entry.state == State::Present) ++counts.tiles;
    if (entry.references > 0) ++counts.referenced;
  }
  return counts;
}

}  // namespace overfly::preview
