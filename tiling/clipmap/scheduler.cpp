#include "tiling/clipmap/scheduler.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace overfly::tiling {
namespace {

constexpr std::size_t kMaxRequests = 1024;
constexpr int kInterestClasses = 4;
constexpr std::int64_t kImpatience_ns = 10'000'000'000;  // of waiting count as a class of interest

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

void Scheduler::mark(const geo::TileKey& key, double knowledge, std::int64_t now_ns) {
  const auto [it, fresh] = waiting_.try_emplace(key);
  Waiting& waiting = it->second;
  if (fresh) waiting.order = next_order_++;
  waiting.knowledge = knowledge;
  waiting.last_ns = now_ns;
  if (std::exchange(waiting.improvement, false)) waiting.worth_ns = -1;
  if (waiting.worth_ns < 0 && isWorth(key, waiting)) {
    waiting.worth_ns = now_ns;
    ++worth_so_far_;
  }
}

void Scheduler::markDue(const geo::TileKey& key, std::int64_t now_ns) {
  const auto [it, fresh] = waiting_.try_emplace(key);
  if (fresh) {
    it->second.order = next_order_++;
    it->second.last_ns = now_ns;
    if (const auto made = made_.find(key); made != made_.end()) it->second.knowledge = made->second;
  }
  if (it->second.worth_ns < 0) it->second.worth_ns = now_ns;
}

void Scheduler::markImprovable(const geo::TileKey& key, std::int64_t now_ns) {
  if (waiting_.contains(key)) return;
  markDue(key, now_ns);
  waiting_.at(key).improvement = true;
}

void Scheduler::markStale(const geo::TileKey& key, std::int64_t now_ns) { stale_[key].since_ns = now_ns; }

void Scheduler::assumeMade(const geo::TileKey& key, double knowledge) { made_[key] = knowledge; }

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

bool Scheduler::isWorth(const geo::TileKey& key, const Waiting& waiting) const {
  const auto made = made_.find(key);
  if (made == made_.end()) return waiting.knowledge >= options_.first_knowledge;
  return waiting.knowledge >= (1 + options_.growth) * made->second;
}

std::int64_t Scheduler::dueTime(const geo::TileKey& key, const Waiting& waiting, bool spare) const {
  if (landed_) return waiting.not_before_ns;
  if (waiting.worth_ns >= 0) return std::max(waiting.not_before_ns, waiting.worth_ns);
  double wait_s = made_.contains(key) ? options_.settle_s : options_.max_wait_s;
  if (spare) wait_s = std::min(wait_s, options_.spare_s);
  return std::max(waiting.not_before_ns, waiting.last_ns + nanoseconds(wait_s));
}

std::int64_t Scheduler::overdue(std::int64_t now_ns) const {
  std::int64_t longest = 0;
  for (const auto& [key, waiting] : waiting_)
    if (waiting.worth_ns >= 0 && !waiting.improvement) longest = std::max(longest, now_ns - waiting.worth_ns);
  return longest;
}

std::size_t Scheduler::worthTiles() const {
  const auto worth = std::count_if(waiting_.begin(), waiting_.end(), [this](const auto& entry) {
    return !entry.second.improvement && (landed_ || entry.second.worth_ns >= 0);
  });
  return static_cast<std::size_t>(worth);
}

std::int64_t Scheduler::dueTime(const Stale& stale) const {
  const double wait_s = landed_ ? 0 : options_.settle_s;
  return std::max(stale.not_before_ns, stale.since_ns + nanoseconds(wait_s));
}

double Scheduler::gainOf(const geo::TileKey& key, const Waiting& waiting) const {
  const auto made = made_.find(key);
  if (made == made_.end()) return 1 + waiting.knowledge;  // something instead of nothing comes first
  return std::max(0.0, waiting.knowledge / std::max(made->second, 1e-6) - 1);
}

void Scheduler::refill(std::int64_t now_ns) {
  const double most = std::max(1, options_.batch_tiles);
  if (!tokens_ns_) tokens_ = most;
  const double elapsed_s = tokens_ns_ ? 1e-9 * static_cast<double>(now_ns - *tokens_ns_) : 0;
  tokens_ = std::min(most, tokens_ + std::max(0.0, elapsed_s) * options_.max_updates_per_s);
  tokens_ns_ = now_ns;
}

void Scheduler::chooseSweeps(std::size_t most, bool spare, std::int64_t now_ns) {
  using Ranked = std::tuple<int, double, std::uint64_t, geo::TileKey>;
  std::vector<Ranked> ranked;
  for (const auto& [key, waiting] : waiting_) {
    if (dueTime(key, waiting, spare) > now_ns) continue;
    const double gain = gainOf(key, waiting) * halved(now_ns - waiting.last_ns, options_.recency_half_life_s);
    // What is worth a sweep is not overtaken for ever by newer ground.
    const std::int64_t waited_ns =
        waiting.worth_ns >= 0 && !waiting.improvement ? now_ns - waiting.worth_ns : 0;
    const int patience =
        static_cast<int>(std::clamp<std::int64_t>(waited_ns / kImpatience_ns, 0, kInterestClasses));
    // After the last frame in the order of place: what a cell's finishing needs of its neighbours is still in
    // memory then.
    ranked.emplace_back(-interest(key, now_ns) - (landed_ ? 0 : patience), landed_ ? 0 : -gain,
                        landed_ ? 0 : waiting.order, key);
  }
  const std::size_t count = std::min(most, ranked.size());
  std::partial_sort(ranked.begin(), ranked.begin() + static_cast<std::ptrdiff_t>(count), ranked.end());
  for (std::size_t i = count; i-- > 0;) sweeps_.push_back(std::get<3>(ranked[i]));
}

void Scheduler::chooseFinishes(std::size_t most, std::int64_t now_ns) {
  using Ranked = std::tuple<int, std::int64_t, geo::TileKey>;
  std::vector<Ranked> ranked;
  for (const auto& [key, stale] : stale_)
    if (!waiting_.contains(key) && dueTime(stale) <= now_ns)
      ranked.emplace_back(-interest(key, now_ns), landed_ ? 0 : stale.since_ns, key);
  const std::size_t count = std::min(most, ranked.size());
  std::partial_sort(ranked.begin(), ranked.begin() + static_cast<std::ptrdiff_t>(count), ranked.end());
  for (std::size_t i = count; i-- > 0;) finishes_.push_back(std::get<2>(ranked[i]));
}

void Scheduler::chooseBatch(std::int64_t now_ns) {
  refill(now_ns);
  // After the last frame all sweeps come before all finishing: nothing is blended twice.
  const std::size_t batch = landed_ ? SIZE_MAX : static_cast<std::size_t>(std::max(1, options_.batch_tiles));
  const bool limited = options_.max_updates_per_s > 0;
  const std::size_t most = limited ? std::min(batch, static_cast<std::size_t>(tokens_)) : batch;
  batch_.clear();
  chooseSweeps(most, false, now_ns);
  if (sweeps_.empty()) chooseFinishes(batch, now_ns);
  // A small batch: work that matters more may come at any moment.
  if (sweeps_.empty() && finishes_.empty())
    chooseSweeps(std::min<std::size_t>(most, (batch - 1) / 4 + 1), true, now_ns);
  if (limited) tokens_ -= static_cast<double>(sweeps_.size());
  batch_.insert(sweeps_.begin(), sweeps_.end());
}

std::optional<TileJob> Scheduler::next(std::int64_t now_ns) {
  if (sweeps_.empty() && finishes_.empty() && running_.empty() && parents_.empty() &&
      running_parents_.empty())
    chooseBatch(now_ns);
  if (!sweeps_.empty()) {
    const geo::TileKey key = sweeps_.back();
    sweeps_.pop_back();
    const Waiting waiting = waiting_.at(key);
    waiting_.erase(key);
    const TileJob job{TileJob::Kind::Sweep, key, waiting.tries};
    running_.emplace(key, std::pair(job, waiting));
    return job;
  }
  const bool sweeping = std::any_of(running_.begin(), running_.end(), [](const auto& entry) {
    return entry.second.first.kind == TileJob::Kind::Sweep;
  });
  if (sweeping) return std::nullopt;  // the finishing waits for all sweeps of the batch ...
  if (!finishes_.empty()) {
    const geo::TileKey key = finishes_.back();
    finishes_.pop_back();
    const auto stale = stale_.find(key);
    const TileJob job{TileJob::Kind::Finish, key, stale == stale_.end() ? 0 : stale->second.tries};
    if (stale != stale_.end()) stale_.erase(stale);
    running_.emplace(key, std::pair(job, Waiting{}));
    return job;
  }
  if (!running_.empty()) return std::nullopt;  // ... and the parents for all of it
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
  return TileJob{top ? TileJob::Kind::Top : TileJob::Kind::FromChildren, entry.second,
                 tries == parent_tries_.end() ? 0 : tries->second};
}

void Scheduler::markParentOf(const geo::TileKey& key) {
  const int level = layout_.levelOf(key.zoom);
  if (const auto parent = layout_.parent(key))
    parents_.insert({level + 1, *parent});
  else if (layout_.top() && layout_.top()->hasChild(key))
    parents_.insert({level + 1, layout_.top()->key()});
}

void Scheduler::done(const TileJob& job, bool changed, std::int64_t now_ns) {
  if (job.kind == TileJob::Kind::Sweep) {
    made_[job.key] = running_.at(job.key).second.knowledge;
    running_.erase(job.key);
    // After the last frame a batch is the whole map: what was swept last is the surest to be in memory still.
    finishes_.insert(landed_ ? finishes_.end() : finishes_.begin(), job.key);
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx) {
        const geo::TileKey key{job.key.zoom, job.key.x + dx, job.key.y + dy};
        if (changed && made_.contains(key) && !batch_.contains(key)) markStale(key, now_ns);
      }
    return;
  }
  if (job.kind == TileJob::Kind::Finish) {
    running_.erase(job.key);
  } else {
    std::erase_if(running_parents_, [&](const ParentEntry& entry) { return entry.second == job.key; });
    std::erase_if(parent_tries_, [&](const auto& entry) { return entry.first.second == job.key; });
  }
  if (changed && job.kind != TileJob::Kind::Top) markParentOf(job.key);
}

void Scheduler::failed(const TileJob& job, std::int64_t now_ns) {
  const int tries = job.tries + 1;
  const std::int64_t not_before_ns = now_ns + nanoseconds(options_.retry_s);
  if (job.kind == TileJob::Kind::Sweep) {
    Waiting before = running_.at(job.key).second;
    running_.erase(job.key);
    if (tries >= options_.max_tries) {
      ++dropped_;
      return;
    }
    if (before.worth_ns < 0) before.worth_ns = now_ns;
    before.tries = tries;
    before.not_before_ns = not_before_ns;
    if (const auto [it, fresh] = waiting_.try_emplace(job.key, before); !fresh) {  // marked again meanwhile
      if (it->second.worth_ns < 0) it->second.worth_ns = now_ns;
      it->second.tries = tries;
      it->second.not_before_ns = not_before_ns;
    }
  } else if (job.kind == TileJob::Kind::Finish) {
    running_.erase(job.key);
    if (tries >= options_.max_tries) {
      ++dropped_;
      return;
    }
    stale_[job.key] = {now_ns, tries, not_before_ns};
  } else {
    const auto it = std::find_if(running_parents_.begin(), running_parents_.end(),
                                 [&](const ParentEntry& entry) { return entry.second == job.key; });
    if (it == running_parents_.end()) return;
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

std::optional<std::int64_t> Scheduler::nextDue(std::int64_t now_ns) const {
  const bool runs = !running_.empty() || !running_parents_.empty();
  if (!sweeps_.empty() || (!runs && (!finishes_.empty() || !parents_.empty()))) return now_ns;
  if (runs) return std::nullopt;
  std::optional<std::int64_t> sweep, finish;
  for (const auto& [key, waiting] : waiting_) {
    const std::int64_t due_ns = std::max(dueTime(key, waiting, true), now_ns);
    if (!sweep || due_ns < *sweep) sweep = due_ns;
  }
  for (const auto& [key, stale] : stale_) {
    if (waiting_.contains(key)) continue;
    const std::int64_t due_ns = std::max(dueTime(stale), now_ns);
    if (!finish || due_ns < *finish) finish = due_ns;
  }
  if (sweep && options_.max_updates_per_s > 0 && tokens_ns_ && tokens_ < 1)
    sweep = std::max(*sweep, *tokens_ns_ + nanoseconds((1 - tokens_) / options_.max_updates_per_s) + 1);
  if (!sweep || !finish) return sweep ? sweep : finish;
  return std::min(*sweep, *finish);
}

std::vector<geo::TileKey> Scheduler::unfinishedTiles() const {
  std::set<geo::TileKey> keys(finishes_.begin(), finishes_.end());
  for (const auto& [key, waiting] : waiting_) keys.insert(key);
  for (const auto& [key, stale] : stale_) keys.insert(key);
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
