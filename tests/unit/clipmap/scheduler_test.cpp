#include "tiling/clipmap/scheduler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "tests/unit/clipmap/random_tile.h"
#include "tiling/clipmap/parent.h"

namespace overfly::tiling {
namespace {

using geo::TileKey;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using testing::tileFromSeed;
using Kind = TileJob::Kind;

constexpr int kZoom = 20;
constexpr int kSize = 4;
constexpr std::int64_t kSecond = 1'000'000'000;

PlaneBox boxOf(const TileKey& key) {
  const auto a = geo::TileLattice::planeOf(key, 0.25, 0.25), b = geo::TileLattice::planeOf(key, 0.75, 0.75);
  return {a.x(), a.y(), b.x(), b.y()};
}

// Every mark is worth a sweep.
SchedulerOptions atOnce() {
  SchedulerOptions options;
  options.first_knowledge = 0;
  options.growth = 0;
  return options;
}

// A store in memory, and level-0 tiles that are what `content` says.
struct Map {
  std::map<TileKey, Tile> tiles;
  std::optional<std::pair<TileKey, Tile>> top;

  [[nodiscard]] const Tile* find(const TileKey& key) const {
    const auto it = tiles.find(key);
    return it == tiles.end() ? nullptr : &it->second;
  }
  bool put(const TileKey& key, Tile tile) {
    if (tile.empty()) return tiles.erase(key) > 0;
    const auto [it, fresh] = tiles.try_emplace(key, tile);
    if (!fresh && it->second == tile) return false;
    it->second = std::move(tile);
    return true;
  }
  bool make(const TileJob& job, const std::map<TileKey, Tile>& content) {
    if (job.kind == Kind::Sweep) return true;
    if (job.kind == Kind::Finish) return put(job.key, content.at(job.key));
    std::array<const Tile*, 4> children{};
    const TopTile top_tile{{job.key.zoom + 1, job.key.x, job.key.y}};
    for (int i = 0; i < 4; ++i)
      children[static_cast<std::size_t>(i)] =
          find(job.kind == Kind::Top ? top_tile.child(i) : geo::childOf(job.key, i));
    if (job.kind == Kind::FromChildren) return put(job.key, makeParent(job.key, children));
    top = {job.key, makeParent(job.key, children)};
    return true;
  }
};

// All levels from the same level-0 tiles, without schedule or growth.
Map inOneGo(const std::map<TileKey, Tile>& content) {
  Map map;
  Layout layout(kZoom);
  for (const auto& [key, tile] : content) {
    map.put(key, tile);
    layout = layout.grown(boxOf(key));
  }
  for (int level = 1; level <= layout.levels() - 2; ++level) {
    std::map<TileKey, std::array<const Tile*, 4>> parents;
    for (const auto& [key, tile] : map.tiles)
      if (layout.levelOf(key.zoom) == level - 1)
        parents[geo::parentOf(key)][static_cast<std::size_t>((key.x & 1) + 2 * (key.y & 1))] = &tile;
    std::map<TileKey, Tile> made;
    for (const auto& [key, children] : parents) made.emplace(key, makeParent(key, children));
    for (auto& [key, tile] : made) map.put(key, std::move(tile));
  }
  if (layout.top()) {
    std::array<const Tile*, 4> children{};
    for (int i = 0; i < 4; ++i) children[static_cast<std::size_t>(i)] = map.find(layout.top()->child(i));
    map.top = {layout.top()->key(), makeParent(layout.top()->key(), children)};
  }
  return map;
}

// Frames arrive in random order while tiles are made, jobs run side by side and end in any order, some tiles
// are made from an earlier frame set first, some jobs fail: the pyramid is the one built in one go.
RC_GTEST_PROP(SchedulerProperty, thePyramidDoesNotDependOnTheOrderOfInsertion, ()) {
  const auto small = [](int low, int end) {
    return *rc::gen::resize(rc::kNominalSize, rc::gen::inRange(low, end));
  };
  const std::int64_t x0 = *rc::gen::element(0, -3, 553341), y0 = *rc::gen::element(0, -5, 362777);
  std::map<TileKey, Tile> content, earlier;
  std::vector<TileKey> order;
  const int n = small(1, 40), spread = small(1, 30);
  for (int i = 0; i < n; ++i) {
    const TileKey key{kZoom, x0 + small(-spread, spread), y0 + small(-spread, spread)};
    content.insert_or_assign(key, tileFromSeed(key, kSize, static_cast<unsigned>(small(0, 1 << 30))));
    earlier.insert_or_assign(key, tileFromSeed(key, kSize, static_cast<unsigned>(i)));
    order.push_back(key);
  }
  SchedulerOptions options;
  options.first_knowledge = small(0, 3);
  options.batch_tiles = small(1, 8);
  options.max_tries = 1000;
  Scheduler scheduler(kZoom, options);
  Map map;
  std::vector<TileJob> running;
  std::int64_t now = 0;
  std::size_t arrived = 0;
  const auto finish = [&](const TileJob& job) {
    if (small(0, 10) == 0) {
      scheduler.failed(job, now);
      return;
    }
    scheduler.done(job, map.make(job, arrived == order.size() ? content : earlier), now);
  };
  for (int step = 0; step < 5000; ++step) {
    now += small(0, 2) * kSecond / 10;
    if (arrived < order.size() && small(0, 3) == 0) {
      scheduler.cover(boxOf(order[arrived]));
      scheduler.mark(order[arrived], 1, now);
      ++arrived;
      if (arrived == order.size())
        for (const auto& [key, tile] : content)
          scheduler.mark(key, 3, now);  // the frame that makes every tile what it is in the end
    }
    if (running.size() < 3)
      if (const auto job = scheduler.next(now)) running.push_back(*job);
    if (!running.empty() && small(0, 2) == 0) {
      const auto i = static_cast<std::size_t>(small(0, static_cast<int>(running.size())));
      const TileJob job = running[i];
      running.erase(running.begin() + static_cast<std::ptrdiff_t>(i));
      finish(job);
    }
    if (arrived == order.size() && scheduler.idle()) break;
  }
  for (const TileJob& job : running) finish(job);
  while (!scheduler.idle()) {
    now += kSecond;
    if (const auto job = scheduler.next(now)) scheduler.done(*job, map.make(*job, content), now);
  }
  const Map expected = inOneGo(content);
  RC_ASSERT(map.tiles.size() == expected.tiles.size());
  RC_ASSERT(map.tiles == expected.tiles);
  RC_ASSERT(map.top.has_value());
  RC_ASSERT(map.top->first == expected.top->first);
  RC_ASSERT(map.top->second == expected.top->second);
  RC_ASSERT(scheduler.running() == 0u);
}

std::vector<TileJob> drain(Scheduler& scheduler, std::int64_t now) {
  std::vector<TileJob> jobs;
  while (const auto job = scheduler.next(now)) {
    jobs.push_back(*job);
    scheduler.done(*job, true, now);
  }
  return jobs;
}

TEST(Scheduler, ParentsFollowTheirChildrenOnceABatchAndTheTopIsLast) {
  Scheduler scheduler(kZoom, atOnce());
  scheduler.cover({0, 0, std::ldexp(7.5, -kZoom), std::ldexp(7.5, -kZoom)});
  ASSERT_EQ(scheduler.layout().levels(), 4);
  for (int x = 0; x < 8; ++x) scheduler.mark({kZoom, x, 3}, 1, 0);
  std::vector<int> levels;
  std::map<std::pair<Kind, TileKey>, int> times;
  for (const TileJob& job : drain(scheduler, 0)) {
    if (job.kind != Kind::Sweep) levels.push_back(kZoom - job.key.zoom);
    EXPECT_EQ(++times[std::pair(job.kind, job.key)], 1);
    EXPECT_EQ(job.kind == Kind::Top, kZoom - job.key.zoom == 3);
  }
  EXPECT_THAT(levels, ElementsAre(0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 3));
}

TEST(Scheduler, ParentsAreMadeThoughFramesNeverStop) {
  SchedulerOptions options = atOnce();
  options.batch_tiles = 4;
  Scheduler scheduler(kZoom, options);
  scheduler.cover({0, 0, std::ldexp(31.5, -kZoom), std::ldexp(31.5, -kZoom)});
  int parents = 0;
  for (int i = 0; i < 100; ++i) {
    for (int k = 0; k < 3; ++k) scheduler.mark({kZoom, (7 * i + k) % 32, i % 32}, 1, i);
    const auto job = scheduler.next(i);
    ASSERT_TRUE(job);
    parents += job->kind == Kind::FromChildren || job->kind == Kind::Top ? 1 : 0;
    scheduler.done(*job, true, i);
  }
  EXPECT_GT(parents, 30);
}

TEST(Scheduler, FinishingWaitsForTheSweepsOfTheBatchAndAParentForTheFinishing) {
  Scheduler scheduler(kZoom, atOnce());
  scheduler.cover({0, 0, std::ldexp(3.5, -kZoom), std::ldexp(3.5, -kZoom)});
  scheduler.mark({kZoom, 0, 0}, 1, 0);
  scheduler.mark({kZoom, 1, 0}, 1, 0);
  for (const Kind kind : {Kind::Sweep, Kind::Finish}) {
    const auto a = scheduler.next(0), b = scheduler.next(0);
    ASSERT_TRUE(a && b);
    EXPECT_EQ(a->kind, kind);
    EXPECT_EQ(b->kind, kind);
    scheduler.done(*a, true, 0);
    EXPECT_FALSE(scheduler.next(0));
    scheduler.done(*b, true, 0);
  }
  EXPECT_EQ(scheduler.next(0)->key, (TileKey{kZoom - 1, 0, 0}));
}

TEST(Scheduler, AnUnchangedTileLeavesItsParentsAlone) {
  Scheduler scheduler(kZoom, atOnce());
  scheduler.cover({0, 0, std::ldexp(3.5, -kZoom), std::ldexp(3.5, -kZoom)});
  scheduler.mark({kZoom, 0, 0}, 1, 0);
  scheduler.done(*scheduler.next(0), false, 0);
  scheduler.done(*scheduler.next(0), false, 0);
  EXPECT_FALSE(scheduler.next(0));
  EXPECT_TRUE(scheduler.idle());
}

// Sweeps whatever is due, without its finishing's and parents' effects on what is due.
std::vector<TileKey> sweptAt(Scheduler& scheduler, std::int64_t now) {
  std::vector<TileKey> keys;
  for (const TileJob& job : drain(scheduler, now))
    if (job.kind == Kind::Sweep) keys.push_back(job.key);
  return keys;
}

// First when the views tell enough, again when they tell much more, at last when no frame has come for long.
TEST(Scheduler, ACellIsSweptWhenItIsWorthIt) {
  SchedulerOptions options;
  options.first_knowledge = 1.5;
  options.growth = 0.5;
  options.max_wait_s = 5;
  options.settle_s = options.spare_s = 20;
  Scheduler scheduler(kZoom, options);
  scheduler.cover({0, 0, std::ldexp(3.5, -kZoom), std::ldexp(3.5, -kZoom)});
  const TileKey key{kZoom, 0, 0};
  scheduler.mark(key, 1.0, 0);
  EXPECT_THAT(sweptAt(scheduler, 2 * kSecond), IsEmpty());
  EXPECT_EQ(scheduler.nextDue(2 * kSecond), 5 * kSecond);
  scheduler.mark(key, 1.6, 3 * kSecond);
  EXPECT_EQ(scheduler.nextDue(3 * kSecond), 3 * kSecond);
  EXPECT_THAT(sweptAt(scheduler, 3 * kSecond), ElementsAre(key));
  scheduler.mark(key, 2.39, 4 * kSecond);
  EXPECT_THAT(sweptAt(scheduler, 4 * kSecond), IsEmpty());
  scheduler.mark(key, 2.41, 5 * kSecond);
  EXPECT_THAT(sweptAt(scheduler, 5 * kSecond), ElementsAre(key));
  scheduler.mark(key, 2.5, 6 * kSecond);
  EXPECT_THAT(sweptAt(scheduler, 25 * kSecond), IsEmpty());
  EXPECT_EQ(scheduler.nextDue(25 * kSecond), 26 * kSecond);
  EXPECT_THAT(sweptAt(scheduler, 26 * kSecond), ElementsAre(key));
  EXPECT_TRUE(scheduler.idle());
}

TEST(Scheduler, ACellThatFewFramesSeeIsSweptWithThemAfterAWhile) {
  SchedulerOptions options;
  options.max_wait_s = 5;
  options.spare_s = 100;
  Scheduler scheduler(kZoom, options);
  scheduler.cover({0, 0, std::ldexp(3.5, -kZoom), std::ldexp(3.5, -kZoom)});
  scheduler.mark({kZoom, 0, 0}, 0.4, 0);
  EXPECT_THAT(sweptAt(scheduler, 5 * kSecond - 1), IsEmpty());
  EXPECT_THAT(sweptAt(scheduler, 5 * kSecond), ElementsAre(TileKey{kZoom, 0, 0}));
}

TEST(Scheduler, AMachineWithTimeToSpareDoesNotWaitForSettlement) {
  SchedulerOptions options;
  options.settle_s = 60;
  options.spare_s = 4;
  Scheduler scheduler(kZoom, options);
  scheduler.cover({0, 0, std::ldexp(3.5, -kZoom), std::ldexp(3.5, -kZoom)});
  scheduler.assumeMade({kZoom, 0, 0}, 2);
  scheduler.mark({kZoom, 0, 0}, 2.1, 0);
  scheduler.mark({kZoom, 3, 3}, 2, 4 * kSecond);
  const auto first = scheduler.next(4 * kSecond);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->key, (TileKey{kZoom, 3, 3}));  // what is worth it comes first
  scheduler.done(*first, true, 4 * kSecond);
  EXPECT_THAT(sweptAt(scheduler, 4 * kSecond), ElementsAre(TileKey{kZoom, 0, 0}));
}

TEST(Scheduler, AfterLandingNothingIsWaitedFor) {
  Scheduler scheduler(kZoom, {});
  scheduler.cover({0, 0, std::ldexp(3.5, -kZoom), std::ldexp(3.5, -kZoom)});
  scheduler.mark({kZoom, 0, 0}, 0.1, 0);
  EXPECT_FALSE(scheduler.next(0));
  scheduler.setLanded(true);
  EXPECT_THAT(sweptAt(scheduler, 0), ElementsAre(TileKey{kZoom, 0, 0}));
}

// A frame that comes while a cell is swept counts for the next time, and a cell is not made twice at once.
TEST(Scheduler, AFrameThatComesDuringTheSweepIsNotForgotten) {
  Scheduler scheduler(kZoom, atOnce());
  scheduler.cover({0, 0, std::ldexp(3.5, -kZoom), std::ldexp(3.5, -kZoom)});
  scheduler.mark({kZoom, 0, 0}, 1, 0);
  const auto job = scheduler.next(0);
  ASSERT_TRUE(job);
  scheduler.mark({kZoom, 0, 0}, 1.5, kSecond);
  EXPECT_FALSE(scheduler.next(kSecond));
  scheduler.done(*job, true, kSecond);
  EXPECT_THAT(sweptAt(scheduler, kSecond), ElementsAre(job->key));
}

// New heights beside a cell change its blended rim: it is finished again, but not swept, and not at once.
TEST(Scheduler, NeighboursOfASweptCellAreFinishedAgainLater) {
  SchedulerOptions options = atOnce();
  options.settle_s = 4;
  Scheduler scheduler(kZoom, options);
  scheduler.cover({0, 0, std::ldexp(7.5, -kZoom), std::ldexp(7.5, -kZoom)});
  const TileKey a{kZoom, 1, 1}, b{kZoom, 2, 2}, far{kZoom, 6, 6};
  scheduler.mark(a, 1, 0);
  scheduler.mark(far, 1, 0);
  (void)drain(scheduler, 0);
  scheduler.mark(b, 1, kSecond);
  (void)drain(scheduler, kSecond);
  EXPECT_EQ(scheduler.nextDue(kSecond), 5 * kSecond);
  std::vector<std::pair<Kind, TileKey>> made;
  for (const TileJob& job : drain(scheduler, 5 * kSecond))
    if (job.kind == Kind::Sweep || job.kind == Kind::Finish) made.emplace_back(job.kind, job.key);
  EXPECT_THAT(made, ElementsAre(std::pair(Kind::Finish, a)));
}

TEST(Scheduler, ACorrectedTileIsDueAtOnce) {
  SchedulerOptions options;
  options.first_knowledge = 10;
  Scheduler scheduler(kZoom, options);
  scheduler.cover({0, 0, std::ldexp(3.5, -kZoom), std::ldexp(3.5, -kZoom)});
  scheduler.markDue({kZoom, 1, 1}, 7);
  EXPECT_EQ(scheduler.next(7)->key, (TileKey{kZoom, 1, 1}));
}

TEST(Scheduler, UpdatesPerSecondAreLimited) {
  SchedulerOptions options = atOnce();
  options.max_updates_per_s = 10;
  options.batch_tiles = 5;
  Scheduler scheduler(kZoom, options);
  scheduler.cover({0, 0, std::ldexp(63.5, -kZoom), std::ldexp(63.5, -kZoom)});
  int made = 0;
  for (int ms = 0; ms < 4000; ms += 10) {
    const std::int64_t now = ms * (kSecond / 1000);
    for (int k = 0; k < 3; ++k) scheduler.mark({kZoom, (ms / 10 * 3 + k) % 64, (ms / 640) % 64}, 1 + ms, now);
    for (const TileJob& job : drain(scheduler, now)) made += job.kind == Kind::Sweep ? 1 : 0;
    if (scheduler.waitingTiles() > 0) {
      const auto due = scheduler.nextDue(now);
      ASSERT_TRUE(due);
      EXPECT_LE(*due, now + kSecond / 5);
    }
  }
  EXPECT_GE(made, 38);
  EXPECT_LE(made, 46);  // 4 s at 10/s, and the first batch
}

TEST(Scheduler, WhatIsLookedAtComesFirst) {
  SchedulerOptions options = atOnce();
  options.batch_tiles = 1;
  Scheduler scheduler(kZoom, options);
  scheduler.cover({0, 0, std::ldexp(1023.5, -kZoom), std::ldexp(1023.5, -kZoom)});
  const TileKey a{kZoom, 100, 100}, b{kZoom, 500, 500}, c{kZoom, 900, 900};
  const auto first = [&](std::int64_t now) {
    Scheduler copy = scheduler;
    return copy.next(now)->key;
  };
  scheduler.mark(a, 1, 0);
  scheduler.mark(b, 2, 0);
  scheduler.mark(c, 1.5, 0);
  EXPECT_EQ(first(0), b);                                   // nobody looks: the larger gain
  scheduler.requested({kZoom - 8, 900 >> 8, 900 >> 8}, 0);  // a coarse tile above c
  EXPECT_EQ(first(0), c);
  EXPECT_EQ(first(60 * kSecond), b);                         // forgotten after a minute
  scheduler.requested({kZoom + 2, 400, 401}, 61 * kSecond);  // a finer tile within a
  EXPECT_EQ(first(61 * kSecond), a);
  scheduler.setClipCentre(geo::TileLattice::planeOf(b, 0.5, 0.5), std::ldexp(20, -kZoom));
  EXPECT_EQ(first(200 * kSecond), b);
  scheduler.setClipCentre(geo::TileLattice::planeOf(c, 0.5, 0.5), std::ldexp(20, -kZoom));
  EXPECT_EQ(first(200 * kSecond), c);
}

TEST(Scheduler, RecentFramesComeBeforeOldOnesOfTheSameGain) {
  SchedulerOptions options = atOnce();
  options.batch_tiles = 1;
  Scheduler scheduler(kZoom, options);
  scheduler.cover({0, 0, std::ldexp(9.5, -kZoom), std::ldexp(9.5, -kZoom)});
  scheduler.mark({kZoom, 1, 1}, 1, 0);
  scheduler.mark({kZoom, 2, 2}, 1, 8 * kSecond);
  EXPECT_EQ(scheduler.next(8 * kSecond)->key, (TileKey{kZoom, 2, 2}));
}

TEST(Scheduler, AFailingTileIsTriedAgainAndThenDropped) {
  SchedulerOptions options = atOnce();
  options.max_tries = 3;
  options.retry_s = 2;
  Scheduler scheduler(kZoom, options);
  scheduler.cover({0, 0, std::ldexp(3.5, -kZoom), std::ldexp(3.5, -kZoom)});
  scheduler.mark({kZoom, 0, 0}, 1, 0);
  std::int64_t now = 0;
  for (int tries = 0; tries < 3; ++tries) {
    const auto job = scheduler.next(now);
    ASSERT_TRUE(job) << tries;
    EXPECT_EQ(job->tries, tries);
    scheduler.failed(*job, now);
    EXPECT_FALSE(scheduler.next(now));
    now += 2 * kSecond;
  }
  EXPECT_FALSE(scheduler.next(now));
  EXPECT_EQ(scheduler.dropped(), 1u);
  EXPECT_THAT(scheduler.unfinishedTiles(), IsEmpty());
}

TEST(Scheduler, WhatIsUnfinishedCanBeTakenUpAgain) {
  Scheduler scheduler(kZoom, atOnce());
  const PlaneBox area{0, 0, std::ldexp(7.5, -kZoom), std::ldexp(7.5, -kZoom)};
  scheduler.cover(area);
  for (int x = 0; x < 3; ++x) scheduler.mark({kZoom, 2 * x, 0}, 1, 0);
  for (int i = 0; i < 3; ++i) scheduler.done(*scheduler.next(0), true, 0);  // sweeps
  scheduler.done(*scheduler.next(0), true, 0);
  const auto running = scheduler.next(0);
  ASSERT_TRUE(running);
  EXPECT_EQ(running->kind, Kind::Finish);
  EXPECT_EQ(scheduler.unfinishedTiles().size(), 2u);
  EXPECT_EQ(scheduler.unfinishedParents().size(), 1u);

  Scheduler after(kZoom, atOnce());
  after.cover(area);
  for (const TileKey& key : scheduler.unfinishedTiles()) after.markDue(key, 0);
  for (const TileKey& key : scheduler.unfinishedParents()) after.markParent(key);
  std::set<TileKey> made;
  for (const TileJob& job : drain(after, 0)) made.insert(job.key);
  EXPECT_TRUE(made.contains({kZoom - 1, 0, 0}));
  EXPECT_TRUE(made.contains({kZoom - 1, 1, 0}));
  EXPECT_TRUE(made.contains({kZoom - 1, 2, 0}));
  EXPECT_TRUE(made.contains(after.layout().top()->key()));
}

// A quick sweep's cell is due, but the flight is not behind by it; a new frame makes it wait like any other.
TEST(Scheduler, AnImprovementIsDueButNobodyWaitsForIt) {
  const TileKey key{kZoom, 5, 7};
  SchedulerOptions options;
  options.first_knowledge = 1;
  Scheduler scheduler(kZoom, options);
  scheduler.cover(boxOf(key));
  scheduler.mark(key, 1.5, 0);
  EXPECT_EQ(scheduler.worthSoFar(), 1u);
  const auto first = scheduler.next(0);
  ASSERT_TRUE(first);
  scheduler.done(*first, true, 0);
  while (const auto job = scheduler.next(0)) scheduler.done(*job, true, 0);

  scheduler.markImprovable(key, kSecond);
  EXPECT_EQ(scheduler.worthTiles(), 0u);
  EXPECT_EQ(scheduler.overdue(5 * kSecond), 0);
  {
    Scheduler other = scheduler;
    const auto again = other.next(kSecond);
    ASSERT_TRUE(again);
    EXPECT_EQ(again->kind, Kind::Sweep);
    EXPECT_EQ(again->key, key);
  }
  scheduler.mark(key, 1.6, 2 * kSecond);  // tells little more
  EXPECT_EQ(scheduler.overdue(5 * kSecond), 0);
  EXPECT_TRUE(scheduler.waits(key));
  scheduler.mark(key, 4, 3 * kSecond);
  EXPECT_EQ(scheduler.worthTiles(), 1u);
  EXPECT_EQ(scheduler.worthSoFar(), 2u);
  EXPECT_EQ(scheduler.overdue(5 * kSecond), 2 * kSecond);
}

// A flight that outruns the machine: new cells are worth more than the old one at any moment, and still its
// turn comes.
TEST(Scheduler, NewGroundDoesNotKeepAnOldCellWaitingForEver) {
  SchedulerOptions options = atOnce();
  options.batch_tiles = 1;
  Scheduler scheduler(kZoom, options);
  const TileKey old{kZoom, 1000, 1000};
  scheduler.cover(boxOf(old));
  scheduler.mark(old, 0.1, 0);  // tells little: least gain
  std::int64_t swept_s = -1;
  for (int second = 0; second < 120 && swept_s < 0; ++second) {
    for (int i = 0; i < 3; ++i) {  // three come, one is swept
      const TileKey fresh{kZoom, 2 * second, 3 * i};
      scheduler.cover(boxOf(fresh));
      scheduler.mark(fresh, 3, second * kSecond);
    }
    for (bool swept = false; !swept;) {
      const auto job = scheduler.next(second * kSecond);
      ASSERT_TRUE(job);
      swept = job->kind == Kind::Sweep;
      if (swept && job->key == old) swept_s = second;
      scheduler.done(*job, true, second * kSecond);
    }
  }
  EXPECT_GE(swept_s, 5);   // what gains more goes first ...
  EXPECT_LT(swept_s, 60);  // ... for a while
}

}  // namespace
}  // namespace overfly::tiling
