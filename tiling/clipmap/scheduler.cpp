#include "tiling/clipmap/scheduler.h"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace overfly::tiling {
namespace {

constexpr std::size_t kMaxRequests = 1024;
constexpr int kInterestClasses = 4;

std::int64_t nanoseconds(double seconds) { return static_cast<std::int64_t>(seconds * 1e9); }
double halved(std::int64_t age_ns, double half_life_s) {
  return std::exp2(-1e-9 * static_cast<double>(std::max<std::int64_t>(age_ns, 0)) / half_life_s);
}

}  // namespace

Scheduler::Scheduler(int base_zoom, const SchedulerOptions& options)
    : options_(options), layout_(base_zoom) {}

void Scheduler::cover(const PlaneBox& area) {
  const Layout after = layout_.grown(area);
  const Growth grown = growth(layout_, after);
  const bool had_tiles = layout_.top().has_value();
  // A former top tile that was still to be made is discarded.
  if (grown.top_changed)
    std::erase_if(parents_, [&](const ParentEntry& entry) { return entry.first == layout_.levels() - 1; });
  layout_ = after;
  for (const geo::TileKey& key : grown.parents) parents_.insert({layout_.levelOf(key.zoom), key});
  if (had_tiles && grown.top_changed) parents_.insert({layout_.levels() - 1, layout_.top()->key()});
}

void Scheduler::mark(const geo::TileKey& key, double gain, std::int64_t now_ns) {
  const auto [it, fresh] = waiting_.try_emplace(key);
  Waiting& waiting = it->second;
  if (fresh) waiting.order = next_order_++;
  if (waiting.new_frames == 0) waiting.first_ns = now_ns;
  ++waiting.new_frames;
  waiting.gain += gain;
  waiting.last_ns = now_ns;
}

void Scheduler::markDue(const geo::TileKey& key, std::int64_t now_ns) {
  const auto [it, fresh] = waiting_.try_emplace(key);
  if (fresh) {
    it->second.order = next_order_++;
    it->second.first_ns = it->second.last_ns = now_ns;
  }
  it->second.due = true;
}

void Scheduler::markParent(const geo::TileKey& key) { parents_.insert({layout_.levelOf(key.zoom), key}); }

void Scheduler::setClipCentre(const std::optional<Eigen::Vector2d>& centre, double radius) {
  clip_centre_ = centre;
  clip_radius_ = radius;
}

void Scheduler::requested(const geo::TileKey& key, std::int64_t now_ns) {
  geo::TileKey lifted = key;
  while (lifted.zoom > layout_.baseZoom()) lifted = geo::parentOf(lifted);
  requests_[lifted] = now_ns;
  if (requests_.size() <= kMaxRequests) return;
  std::vector<std::int64_t> times;
  for (const auto& [request, time_ns] : requests_) times.push_back(time_ns);
  const auto middle = times.begin() + kMaxRequests / 2;
  std::nth_element(times.begin(), middle, times.end());
  std::erase_if(requests_, [limit = *middle](const auto& request) { return request.second < limit; });
}

// 0 .. 3: coarse on purpose, so that gain decides among tiles that are looked at alike.
int Scheduler::interest(const geo::TileKey& key, std::int64_t now_ns) const {
  double value = 0;
  if (clip_centre_ && clip_radius_ > 0) {
    const double distance = (geo::TileLattice::planeOf(key, 0.5, 0.5) - *clip_centre_).norm() / clip_radius_;
    value = 1 / (1 + distance * distance);
  }
  if (!requests_.empty()) {
    const int coarsest = requests_.begin()->first.zoom;  // the map is ordered by zoom first
    for (geo::TileKey k = key; k.zoom >= coarsest; k = geo::parentOf(k))
      if (const auto it = requests_.find(k); it != requests_.end())
        value = std::max(value, halved(now_ns - it->second, options_.interest_half_life_s));
  }
  return std::min(static_cast<int>(value * kInterestClasses), kInterestClasses - 1);
}

std::int64_t Scheduler::dueTime(const Waiting& waiting) const {
  const bool enough = waiting.due || waiting.new_frames >= options_.min_new_frames;
  const std::int64_t by_wait_ns = waiting.first_ns + nanoseconds(options_.max_wait_s);
  return std::max(waiting.not_before_ns, enough ? waiting.first_ns : by_wait_ns);
}

bool Scheduler::isDue(const Waiting& waiting, std::int64_t now_ns) const {
  return dueTime(waiting) <= now_ns;
}

void Scheduler::refill(std::int64_t now_ns) {
  const double most = std::max(1, options_.batch_tiles);
  if (!tokens_ns_) tokens_ = most;
  const double elapsed_s = tokens_ns_ ? 1e-9 * static_cast<double>(now_ns - *tokens_ns_) : 0;
  tokens_ = std::min(most, tokens_ + std::max(0.0, elapsed_s) * options_.max_updates_per_s);
  tokens_ns_ = now_ns;
}

void Scheduler::chooseBatch(std::int64_t now_ns) {
  refill(now_ns);
  std::size_t most = static_cast<std::size_t>(std::max(1, options_.batch_tiles));
  if (options_.max_updates_per_s > 0) most = std::min(most, static_cast<std::size_t>(tokens_));
  using Ranked = std::tuple<int, double, std::uint64_t, geo::TileKey>;
  std::vector<Ranked> ranked;
  for (const auto& [key, waiting] : waiting_) {
    if (running_.contains(key) || !isDue(waiting, now_ns)) continue;
    const double gain = waiting.gain * halved(now_ns - waiting.last_ns, options_.recency_half_life_s);
    ranked.emplace_back(-interest(key, now_ns), -gain, waiting.order, key);
  }
  const std::size_t count = std::min(most, ranked.size());
  std::partial_sort(ranked.begin(), ranked.begin() + static_cast<std::ptrdiff_t>(count), ranked.end());
  for (std::size_t i = count; i-- > 0;) batch_.push_back(std::get<3>(ranked[i]));
  if (options_.max_updates_per_s > 0) tokens_ -= static_cast<double>(count);
}

std::optional<TileJob> Scheduler::next(std::int64_t now_ns) {
  if (batch_.empty() && running_.empty() && parents_.empty() && running_parents_.empty()) chooseBatch(now_ns);
  if (!batch_.empty()) {
    const geo::TileKey key = batch_.back();
    batch_.pop_back();
    const Waiting& waiting = waiting_.at(key);
    const TileJob job{TileJob::Kind::FromFrames, key, waiting.new_frames, waiting.tries};
    waiting_.erase(key);
    running_.emplace(key, job);
    return job;
  }
  if (!running_.empty()) return std::nullopt;  // their parents wait for all of the batch
  return nextParent();
}

std::optional<TileJob> Scheduler::nextParent() {
  if (parents_.empty()) return std::nullopt;
  const ParentEntry entry = *parents_.begin();
  // Its children may be among those that are being made.
  if (!running_parents_.empty() && running_parents_.begin()->first < entry.first) return std::nullopt;
  parents_.erase(parents_.begin());
  running_parents_.insert(entry);
  const bool top = entry.first == layout_.levels() - 1;
  const auto tries = parent_tries_.find(entry);
  return TileJob{top ? TileJob::Kind::Top : TileJob::Kind::FromChildren, entry.second, 0,
                 tries == parent_tries_.end() ? 0 : tries->second};
}

void Scheduler::addParentOf(const geo::TileKey& key) {
  const int level = layout_.levelOf(key.zoom);
  if (const auto parent = layout_.parent(key))
    parents_.insert({level + 1, *parent});
  else if (layout_.top() && layout_.top()->hasChild(key))
    parents_.insert({level + 1, layout_.top()->key()});
}

void Scheduler::done(const TileJob& job, bool changed, std::int64_t) {
  if (job.kind == TileJob::Kind::FromFrames) {
    running_.erase(job.key);
  } else {
    std::erase_if(running_parents_, [&](const ParentEntry& entry) { return entry.second == job.key; });
    std::erase_if(parent_tries_, [&](const auto& entry) { return entry.first.second == job.key; });
  }
  if (changed && job.kind != TileJob::Kind::Top) addParentOf(job.key);
}

void Scheduler::failed(const TileJob& job, std::int64_t now_ns) {
  const int tries = job.tries + 1;
  if (job.kind == TileJob::Kind::FromFrames) {
    running_.erase(job.key);
    if (tries >= options_.max_tries) {
      ++dropped_;
    } else {
      const auto [it, fresh] = waiting_.try_emplace(job.key);  // not fresh: marked again meanwhile
      if (fresh) {
        it->second.order = next_order_++;
        it->second.first_ns = it->second.last_ns = now_ns;
      }
      it->second.new_frames += job.new_frames;
      it->second.due = true;
      it->second.tries = tries;
      it->second.not_before_ns = now_ns + nanoseconds(options_.retry_s);
    }
  } else {
    const auto it = std::find_if(running_parents_.begin(), running_parents_.end(),
                                 [&](const ParentEntry& entry) { return entry.second == job.key; });
    if (it != running_parents_.end()) {
      const ParentEntry entry = *it;
      running_parents_.erase(it);
      if (tries >= options_.max_tries) {
        ++dropped_;
        parent_tries_.erase(entry);
      } else {
        parent_tries_[entry] = tries;
        parents_.insert(entry);
      }
    }
  }
}

std::optional<std::int64_t> Scheduler::nextDue(std::int64_t now_ns) const {
  if (!batch_.empty() || (!parents_.empty() && running_.empty() && running_parents_.empty())) return now_ns;
  if (!running_.empty() || !running_parents_.empty()) return std::nullopt;
  std::optional<std::int64_t> soonest;
  for (const auto& [key, waiting] : waiting_) {
    const std::int64_t due_ns = std::max(dueTime(waiting), now_ns);
    if (!soonest || due_ns < *soonest) soonest = due_ns;
  }
  if (soonest && options_.max_updates_per_s > 0 && tokens_ns_ && tokens_ < 1)
    soonest = std::max(*soonest, *tokens_ns_ + nanoseconds((1 - tokens_) / options_.max_updates_per_s) + 1);
  return soonest;
}

std::vector<geo::TileKey> Scheduler::unfinishedTiles() const {
  std::set<geo::TileKey> keys;
  for (const auto& [key, waiting] : waiting_) keys.insert(key);
  for (const auto& [key, job] : running_) keys.insert(key);
  return {keys.begin(), keys.end()};
}

std::vector<geo::TileKey> Scheduler::unfinishedParents() const {
  std::set<geo::TileKey> keys;
  for (const std::set<ParentEntry>* entries : {&parents_, &running_parents_})
    for (const ParentEntry& entry : *entries)
      if (entry.first != layout_.levels() - 1) keys.insert(entry.second);
  return {keys.begin(), keys.end()};
}

}  // namespace overfly::tiling
