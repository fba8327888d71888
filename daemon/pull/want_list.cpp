#include "daemon/pull/want_list.h"

#include <algorithm>

namespace overfly::pull {
namespace {

constexpr double kStaleShare = 1.0 / 3;
constexpr std::uint64_t kGuess = 16 * 1024;  // bytes of a layer of which nothing is known yet

// Colour is what an operator steers by, then heights.
int layerRank(tiling::Layer layer) {
  switch (layer) {
    case tiling::Layer::Color:
      return 0;
    case tiling::Layer::Elevation:
      return 1;
    case tiling::Layer::ElevationMax:
      return 2;
    default:
      return 3;
  }
}

bool related(const geo::TileKey& a, const geo::TileKey& b) {
  const auto& fine = a.zoom >= b.zoom ? a : b;
  const auto& coarse = a.zoom >= b.zoom ? b : a;
  const int up = fine.zoom - coarse.zoom;
  return (fine.x >> up) == coarse.x && (fine.y >> up) == coarse.y;
}

}  // namespace

std::uint64_t WantList::estimate(const Listed& listed) const {
  if (listed.bytes > 0) return listed.bytes + link::kRecordHead + link::kLayerHead;
  const auto mean = mean_bytes_.find(listed.what.layer);
  return mean == mean_bytes_.end() ? kGuess : mean->second;
}

bool WantList::isLooked(const geo::TileKey& key) const {
  return std::ranges::any_of(looks_, [&](const geo::TileKey& look) { return related(look, key); });
}

WantList::Rank WantList::rankOf(const Want& want) const {
  Rank rank{0, want.listed.what.key.zoom, layerRank(want.listed.what.layer), want.listed.revision};
  if (want.stale && !want.looked)
    if (const auto last = refreshed_.find(want.listed.what); last != refreshed_.end())
      rank.refreshed = last->second;
  return rank;
}

WantList::Line& WantList::lineOf(const Want& want) {
  return want.looked ? looked_ : want.stale ? stale_ : fresh_;
}

void WantList::enqueue(Want want) {
  const LayerKey what = want.listed.what;
  want.stale = revisionOf(what) != 0;
  want.looked = isLooked(what.key);
  const Rank rank = rankOf(want);
  waiting_bytes_ += estimate(want.listed);
  lineOf(want).emplace(rank, what);
  ranks_[what] = rank;
  waiting_[what] = want;
}

void WantList::dequeue(const LayerKey& what) {
  const auto found = waiting_.find(what);
  lineOf(found->second).erase({ranks_[what], what});
  waiting_bytes_ -= std::min(waiting_bytes_, estimate(found->second.listed));
  ranks_.erase(what);
  waiting_.erase(found);
}

void WantList::closePage(std::uint64_t number) {
  if (number == 0) return;
  for (auto& page : pages_)
    if (page.number == number) --page.open;
  while (!pages_.empty() && pages_.front().open == 0) {
    ready_ = pages_.front().cursor;
    pages_.pop_front();
  }
}

void WantList::addPage(const std::string& cursor, const std::vector<Listed>& page) {
  const auto number = next_page_++;
  // One open slot more than wanted, so that the page cannot close before it is whole.
  pages_.push_back({number, cursor, 1});
  for (const Listed& one : page) {
    if (revisionOf(one.what) >= one.revision) continue;
    Want want{one, number};
    if (const auto waits = waiting_.find(one.what); waits != waiting_.end()) {
      // In an earlier page too: that one no longer needs its own revision, for this one is later.
      const Want before = waits->second;
      if (before.page != 0 && before.listed.revision >= one.revision)
        continue;  // that page stays open for it
      dequeue(one.what);
      closePage(before.page);
      want.listed.revision = std::max(before.listed.revision, one.revision);
    } else if (const auto flies = in_flight_.find(one.what); flies != in_flight_.end()) {
      if (flies->second.page == 0) {
        flies->second.page = number;
        flies->second.listed.revision = std::max(flies->second.listed.revision, one.revision);
        ++pages_.back().open;
      } else if (flies->second.listed.revision < one.revision) {
        // What flies may be the older one: done() puts it back in line if so.
        closePage(flies->second.page);
        flies->second.page = number;
        flies->second.listed.revision = one.revision;
        ++pages_.back().open;
      }
      continue;
    }
    ++pages_.back().open;
    enqueue(want);
  }
  closePage(number);
}

void WantList::add(const Listed& one) {
  if (revisionOf(one.what) >= one.revision) return;
  if (const auto flies = in_flight_.find(one.what); flies != in_flight_.end()) {
    flies->second.listed.revision = std::max(flies->second.listed.revision, one.revision);
    return;
  }
  if (const auto waits = waiting_.find(one.what); waits != waiting_.end()) {
    waits->second.listed.revision = std::max(waits->second.listed.revision, one.revision);
    return;
  }
  enqueue({one, 0});
}

void WantList::have(const LayerKey& what, std::uint64_t revision) {
  auto& known = revisions_[what];
  known = std::max(known, revision);
}

std::uint64_t WantList::revisionOf(const LayerKey& what) const {
  const auto known = revisions_.find(what);
  return known == revisions_.end() ? 0 : known->second;
}

void WantList::clear() { *this = WantList(); }

std::vector<Listed> WantList::take(std::uint64_t bytes, std::size_t most) {
  std::vector<Listed> out;
  std::uint64_t taken = 0;
  while (out.size() < most && taken < bytes && !waiting_.empty()) {
    const bool only_stale = fresh_.empty();
    const bool stale_turn = !stale_.empty() && (only_stale || fresh_credit_ < 0);
    Line& line = !looked_.empty() ? looked_ : stale_turn ? stale_ : fresh_;
    const LayerKey what = line.begin()->second;
    const Want want = waiting_[what];
    const auto size = estimate(want.listed);
    if (!out.empty() && taken + size > bytes + bytes / 2) break;
    if (&line == &stale_ && !only_stale) fresh_credit_ += static_cast<double>(size) * (1 - kStaleShare);
    if (&line == &fresh_ && !stale_.empty()) fresh_credit_ -= static_cast<double>(size) * kStaleShare;
    taken += size;
    dequeue(what);
    in_flight_[what] = want;
    out.push_back(want.listed);
  }
  return out;
}

void WantList::done(const LayerKey& what, std::uint64_t revision, std::uint64_t bytes) {
  const auto found = in_flight_.find(what);
  if (found == in_flight_.end()) return;
  Want want = found->second;
  in_flight_.erase(found);
  refreshed_[what] = ++clock_;
  if (bytes > 0) {
    auto& mean = mean_bytes_[what.layer];
    mean = mean == 0 ? bytes : (7 * mean + bytes) / 8;
  }
  if (revision != 0 && revision < want.listed.revision && !want.again) {
    // It changed while it was on its way. Asked for once more it comes as listed.
    have(what, revision);
    want.again = true;
    enqueue(want);
    return;
  }
  have(what, std::max(revision, want.listed.revision));
  closePage(want.page);
}

void WantList::giveBack(const LayerKey& what) {
  const auto found = in_flight_.find(what);
  if (found == in_flight_.end()) return;
  const Want want = found->second;
  in_flight_.erase(found);
  enqueue(want);
}

void WantList::lookAt(const std::vector<geo::TileKey>& tiles) {
  looks_ = tiles;
  std::vector<Want> moved;
  for (const auto& [what, want] : waiting_)
    if (want.looked != isLooked(what.key)) moved.push_back(want);
  for (const Want& want : moved) {
    dequeue(want.listed.what);
    enqueue(want);
  }
}

std::optional<std::string> WantList::cursor() {
  auto out = std::move(ready_);
  ready_.reset();
  return out;
}

std::uint64_t WantList::wantedRevision() const {
  std::uint64_t oldest = 0;
  for (const auto* wants : {&waiting_, &in_flight_})
    for (const auto& [what, want] : *wants)
      if (oldest == 0 || want.listed.revision < oldest) oldest = want.listed.revision;
  return oldest;
}

}  // namespace overfly::pull
