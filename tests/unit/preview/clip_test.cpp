// The caches' decisions, without a GPU.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <thread>

#include "render/preview/clip_cache.h"
#include "tests/unit/preview/synthetic_map.h"

namespace overfly::preview {
namespace {

using test::SyntheticMap;
using namespace std::chrono_literals;

Focus focusAt(const Domain& domain, double x, double y, int finest = 0) {
  Focus focus;
  focus.centres.assign(static_cast<std::size_t>(domain.levels() - 1), {x, y});
  focus.finest = finest;
  return focus;
}

Domain domainOf(int tiles, int tile_size = 16) {
  MapExtent extent;
  extent.lattice = geo::TileLattice::local({0.8, 0.2, 0});
  extent.tile_size = tile_size;
  extent.finest_zoom = 22;
  const geo::TileKey first{22, -77, 1001};  // indices of both signs
  extent.min = geo::TileLattice::planeOf(first);
  extent.max = geo::TileLattice::planeOf({22, first.x + tiles, first.y + tiles});
  return Domain::create(extent).value();
}

RC_GTEST_PROP(ClipLayout, NoTwoTilesOfTheActiveAreasShareASlot, ()) {
  const int tiles = *rc::gen::inRange(1, 400), active = *rc::gen::inRange(2, 9);
  const int slots = *rc::gen::inRange(80, 600);
  const Domain domain = domainOf(tiles);
  ClipLayout layout(domain, {active, 1, slots});
  for (int move = 0; move < 5; ++move) {
    const double size = domain.texelsAcross(0);
    layout.moveTo(focusAt(domain, *rc::gen::inRange(-100, 1100) * size / 1000,
                          *rc::gen::inRange(-100, 1100) * size / 1000,
                          *rc::gen::inRange(0, domain.levels() - 1)));
    std::set<int> seen;
    for (int l = 0; l <= domain.levels() - 2; ++l) {
      const TileWindow& window = layout.active(l);
      RC_ASSERT(window.x >= 0 && window.y >= 0);
      RC_ASSERT(window.x + window.width <= domain.tilesAcross(l));
      for (int y = window.y; y < window.y + window.height; ++y) {
        for (int x = window.x; x < window.x + window.width; ++x) {
          const int slot = layout.slot(l, domain.key(l, x, y));
          RC_ASSERT(slot >= 0 && slot < layout.slots());
          RC_ASSERT(seen.insert(slot).second);
        }
      }
    }
  }
}

TEST(ClipLayout, ATileKeepsItsSlotWhileTheCentreMoves) {
  const Domain domain = domainOf(200);
  ClipLayout layout(domain, {5, 1, 400});
  layout.moveTo(focusAt(domain, 1600, 1600));
  std::map<std::pair<int, int>, int> before;
  const TileWindow window = layout.active(0);
  for (int y = window.y; y < window.y + 5; ++y)
    for (int x = window.x; x < window.x + 5; ++x) before[{x, y}] = layout.slot(0, domain.key(0, x, y));
  layout.moveTo(focusAt(domain, 1600 + 32, 1600 + 16));
  EXPECT_NE(layout.active(0), window);
  for (const auto& [tile, slot] : before)
    if (layout.active(0).contains(tile.first, tile.second)) {
      EXPECT_EQ(layout.slot(0, domain.key(0, tile.first, tile.second)), slot);
    }
}

TEST(ClipLayout, AMapOfMoreLevelsThanFitFloatsItsStackOverThoseOfTheView) {
  const Domain domain = domainOf(3000);
  const ClipLayout small(domainOf(10), {5, 1, 200});
  EXPECT_FALSE(small.floating());
  ClipLayout layout(domain, {5, 1, 200});
  EXPECT_TRUE(layout.floating());
  EXPECT_LE(layout.slots(), 200);
  layout.moveTo(focusAt(domain, 20000, 20000, 3));
  EXPECT_EQ(layout.active(2).width, 0);
  EXPECT_EQ(layout.active(3).width, 5);
  // Beyond the stack a bridge to the top remains.
  for (int l = 3; l <= domain.levels() - 2; ++l)
    EXPECT_GE(layout.active(l).width, std::min(3, domain.tilesAcross(l)));
  EXPECT_LT(layout.active(domain.levels() - 4).width, 5);
}

TEST(RingOrder, GoesOutwardsInSquaresAndAheadFirst) {
  const TileWindow window{10, 20, 5, 5};
  const auto order = ringOrder(window, {12, 22}, {1, 0});
  ASSERT_EQ(order.size(), 25u);
  EXPECT_EQ(order.front(), Eigen::Vector2i(12, 22));
  int ring = 0;
  for (const Eigen::Vector2i& t : order) {
    const int r = (t - Eigen::Vector2i(12, 22)).cwiseAbs().maxCoeff();
    EXPECT_GE(r, ring);
    ring = r;
  }
  EXPECT_EQ(order[1].x(), 13);  // of the first ring, those ahead
  EXPECT_EQ(order[8].x(), 11);  // and those behind last
}

// Counts what the source is asked for.
class FailingMap : public SyntheticMap {
 public:
  using SyntheticMap::SyntheticMap;
  Result<SourceTilePtr> load(const geo::TileKey& key) override {
    if (failing) return fail(ErrorCode::Io, "the disk is away");
    return SyntheticMap::load(key);
  }
  bool failing = false;
};

struct RamFixture : ::testing::Test {
  SyntheticMap::Options options() {
    SyntheticMap::Options o;
    o.tile_size = 16;
    o.tiles = 8;
    return o;
  }
  geo::TileKey key(int x, int y) { return {map.corner().zoom, map.corner().x + x, map.corner().y + y}; }
  FailingMap map{options(), test::townHeight};
  Clock::time_point now = Clock::now();
};

TEST_F(RamFixture, NeededTilesStayAndOthersGoByLastUse) {
  const std::size_t one = RamCache::bytesOf(**map.load(key(0, 0)));
  RamCache ram(map, {.budget_bytes = 4 * one});
  const auto client = ram.addClient();
  ram.want(client, {key(0, 0), key(1, 0)}, {key(2, 0), key(3, 0), key(4, 0)});
  while (ram.loadNext(now)) {
  }
  EXPECT_EQ(ram.counts().tiles, 4u);  // prefetching ends at the budget
  EXPECT_EQ(ram.find(key(2, 0), now).state, RamCache::State::Present);
  ram.want(client, {key(0, 0), key(5, 0), key(6, 0)}, {});
  while (ram.loadNext(now)) {
  }
  EXPECT_EQ(ram.find(key(0, 0), now).state, RamCache::State::Present);
  EXPECT_EQ(ram.find(key(5, 0), now).state, RamCache::State::Present);
  EXPECT_EQ(ram.find(key(6, 0), now).state, RamCache::State::Present);
  EXPECT_EQ(ram.find(key(1, 0), now).state, RamCache::State::Unknown);  // used longest ago
  EXPECT_EQ(ram.find(key(2, 0), now).state, RamCache::State::Present);
  // A second view's need keeps a tile that the first lets go.
  const auto other = ram.addClient();
  ram.want(other, {key(0, 0)}, {});
  ram.want(client, {key(1, 1), key(2, 1), key(3, 1), key(4, 1)}, {});
  while (ram.loadNext(now)) {
  }
  EXPECT_EQ(ram.find(key(0, 0), now).state, RamCache::State::Present);
  ram.removeClient(other);
  ram.want(client, {key(1, 1), key(2, 1), key(3, 1), key(4, 1), key(5, 1)}, {});
  while (ram.loadNext(now)) {
  }
  EXPECT_EQ(ram.find(key(0, 0), now).state, RamCache::State::Unknown);
}

TEST_F(RamFixture, AnAbsentTileIsNotAskedForAgainUntilItsMarkExpiresOrItAppears) {
  RamCache ram(map, {.absent_life = 5s});
  const auto client = ram.addClient();
  ram.want(client, {key(20, 20)}, {});
  EXPECT_TRUE(ram.loadNext(now));
  EXPECT_EQ(ram.find(key(20, 20), now).state, RamCache::State::Absent);
  EXPECT_FALSE(ram.loadNext(now + 4s));
  EXPECT_TRUE(ram.loadNext(now + 6s));
  map.change(20, 20, test::townHeight, false);
  ASSERT_TRUE(ram.poll().has_value());
  EXPECT_TRUE(ram.loadNext(now + 6s));
  EXPECT_EQ(ram.find(key(20, 20), now + 6s).state, RamCache::State::Present);
}

TEST_F(RamFixture, AnUnreadableTileIsDelayedThenAbsentAndItsOldContentStays) {
  RamCache ram(map, {.retry = 200ms, .max_delays = 3});
  const auto client = ram.addClient();
  ram.want(client, {key(0, 0), key(1, 0)}, {});
  EXPECT_TRUE(ram.loadNext(now));
  map.change(0, 0, test::townHeight, false);
  ASSERT_TRUE(ram.poll().has_value());
  map.failing = true;
  EXPECT_TRUE(ram.loadNext(now));
  EXPECT_TRUE(ram.loadNext(now));
  EXPECT_EQ(ram.find(key(0, 0), now).state, RamCache::State::Present);
  EXPECT_EQ(ram.find(key(1, 0), now).state, RamCache::State::Delayed);
  EXPECT_FALSE(ram.loadNext(now + 100ms));
  for (int i = 1; i <= 4; ++i)
    while (ram.loadNext(now + i * 300ms)) {
    }
  EXPECT_EQ(ram.find(key(1, 0), now + 1200ms).state, RamCache::State::Absent);
}

TEST_F(RamFixture, SoftExpiryReloadsWhileTheOldTileIsUsedAndHardExpiryTakesItAway) {
  map.setLife(1s, 1s);
  RamCache ram(map);
  const auto client = ram.addClient();
  ram.want(client, {key(0, 0)}, {});
  EXPECT_TRUE(ram.loadNext(now));
  EXPECT_FALSE(ram.loadNext(now + 900ms));
  const std::uint64_t first = ram.find(key(0, 0), now + 1500ms).generation;
  EXPECT_EQ(ram.find(key(0, 0), now + 1500ms).state, RamCache::State::Present);
  EXPECT_EQ(ram.find(key(0, 0), now + 2100ms).tile, nullptr);
  EXPECT_TRUE(ram.loadNext(now + 2100ms));
  EXPECT_EQ(ram.find(key(0, 0), now + 2200ms).state, RamCache::State::Present);
  EXPECT_GT(ram.find(key(0, 0), now + 2200ms).generation, first);
}

// A life shorter than loading takes: every load makes another tile due.
TEST_F(RamFixture, LoadingWhatIsDueEndsWhereTilesOutliveTheirLifeMeanwhile) {
  map.setLife(0s, std::nullopt);
  RamCache ram(map);
  const auto client = ram.addClient();
  ram.want(client, {key(0, 0), key(1, 0), key(2, 0)}, {key(3, 0)});
  ram.loadDue();
  EXPECT_EQ(ram.counts().tiles, 4u);
  EXPECT_EQ(map.loads(), 4u);
}

// Remembers what GPU memory would hold.
struct FakeSink : TextureSink {
  void uploadTile(int slot, const TileImage& image) override {
    bounds[slot] = image.bounds;
    order.push_back(slot);
    time += cost;
  }
  void uploadBounds(int slot, const BoundsPatch& patch) override {
    const auto size = static_cast<int>(std::lround(std::sqrt(static_cast<double>(bounds[slot].size()))));
    for (int y = 0; y < patch.size; ++y)
      for (int x = 0; x < patch.size; ++x)
        bounds[slot][static_cast<std::size_t>((patch.y + y) * size + patch.x + x)] =
            patch.values[static_cast<std::size_t>(y * patch.size + x)];
  }
  void uploadTop(const TopImage& image) override { top = image; }
  void uploadTopBounds(int mip, const BoundsPatch& patch) override {
    TileImage& level = top.levels[static_cast<std::size_t>(mip)];
    for (int y = 0; y < patch.size; ++y)
      for (int x = 0; x < patch.size; ++x)
        level.bounds[static_cast<std::size_t>((patch.y + y) * level.size + patch.x + x)] =
            patch.values[static_cast<std::size_t>(y * patch.size + x)];
  }
  std::map<int, std::vector<float>> bounds;
  std::vector<int> order;
  TopImage top;
  Clock::time_point time = Clock::now();
  std::chrono::nanoseconds cost{0};
};

struct ClipFixture : RamFixture {
  RamCache ram{map};
  FakeSink sink;
  Domain domain = Domain::create(*map.extent()).value();
  ClipCache cache{domain, ram, sink, ClipCache::Options{{5, 1, 400}, NoData::Hole, LoadOrder::DetailFirst},
                  [this] { return sink.time; }};
  Eigen::Vector2d middle = (domain.minTexel() + domain.maxTexel()) / 2;
  Focus focus = focusAt(domain, middle.x(), middle.y());

  void load() {
    while (ram.loadNext(sink.time)) {
    }
  }
  void settle() {
    for (int i = 0; i < 4; ++i) {
      cache.update(focus, {});
      load();
    }
    ASSERT_TRUE(cache.update(focus, {}).settled());
  }
  // Invariant 4: no bound below a finer one.
  void expectBoundsHold() {
    const int size = domain.tileSize();
    for (int l = 0; l <= domain.levels() - 2; ++l) {
      const TileWindow& window = cache.layout().active(l);
      const auto entries = cache.table(l);
      for (std::size_t i = 0; i < entries.size(); ++i) {
        if (entries[i].slot == 0) continue;
        const int tx = window.x + static_cast<int>(i) % window.width,
                  ty = window.y + static_cast<int>(i) / window.width;
        const std::vector<float>& fine = sink.bounds[entries[i].slot - 1];
        for (int y = 0; y < size; ++y) {
          for (int x = 0; x < size; ++x) {
            const int px = (tx * size + x) / 2, py = (ty * size + y) / 2;
            float coarse = 0;
            if (l + 1 <= domain.levels() - 2) {
              const int slot = cache.layout().slot(l + 1, domain.key(l + 1, px / size, py / size));
              coarse = sink.bounds[slot][static_cast<std::size_t>(py % size * size + px % size)];
            } else {
              coarse = sink.top.levels[0].bounds[static_cast<std::size_t>(py * size + px)];
            }
            ASSERT_GE(coarse, fine[static_cast<std::size_t>(y * size + x)]) << l;
          }
        }
      }
    }
  }
};

TEST_F(ClipFixture, LoadsCoarseLevelsFirstAndFillsTheActiveAreas) {
  settle();
  ASSERT_FALSE(sink.order.empty());
  EXPECT_EQ(cache.finestAt(middle.cast<int>()), 0);
  // A slot of a finer level never precedes one of a coarser.
  std::map<int, int> level_of;
  for (int l = 0; l <= domain.levels() - 2; ++l) {
    const TileWindow& w = cache.layout().active(l);
    for (int y = w.y; y < w.y + w.height; ++y)
      for (int x = w.x; x < w.x + w.width; ++x) level_of[cache.layout().slot(l, domain.key(l, x, y))] = l;
  }
  int last = 100;
  std::set<int> once;
  for (const int slot : sink.order) {
    if (!once.insert(slot).second) continue;
    EXPECT_LE(level_of[slot], last);
    last = level_of[slot];
  }
  expectBoundsHold();
}

TEST_F(ClipFixture, SpendsNoMoreThanTheBudgetButAlwaysSomething) {
  sink.cost = 2ms;
  cache.update(focus, {});
  load();
  int frames = 0;
  for (ClipCache::Update update{.uploads = 0, .waiting = 1}; !update.settled() && frames < 500; ++frames) {
    const Clock::time_point begin = sink.time;
    update = cache.update(focus, {.time = 7ms});
    EXPECT_LE(sink.time - begin, 7ms);
    EXPECT_GT(update.uploads, 0);
    load();
  }
  EXPECT_GT(frames, 5);
  EXPECT_LT(frames, 500);
  sink.cost = 30ms;  // one tile alone is beyond the budget: still one a frame
  map.change(3, 3, test::townHeight);
  ASSERT_TRUE(ram.poll().has_value());
  load();
  EXPECT_EQ(cache.update(focus, {.time = 7ms}).uploads, 1);
}

TEST_F(ClipFixture, ImagesMadeAsideAreThoseMadeAtOnce) {
  settle();
  FakeSink other;
  RamCache other_ram{map};
  ClipCache aside{domain, other_ram, other, ClipCache::Options{{5, 1, 400}, NoData::Hole, {}},
                  [&other] { return other.time; }};
  ClipCache::Update update;
  const Clock::time_point until = Clock::now() + 60s;
  do {
    update = aside.update(focus, {.aside = true});
    other_ram.loadDue();
    std::this_thread::sleep_for(1ms);
  } while ((!aside.ready() || !update.settled()) && Clock::now() < until);
  ASSERT_TRUE(update.settled());
  EXPECT_EQ(aside.baseHeight(), cache.baseHeight());
  EXPECT_EQ(other.bounds, sink.bounds);
  EXPECT_EQ(other.top.levels[0].bounds, sink.top.levels[0].bounds);
}

// An image begun before a change, made after the changed tile was uploaded by an update that waits for none.
TEST_F(ClipFixture, AnImageMadeAsideNeverReplacesANewerOne) {
  settle();
  const auto rise = [&](float by) {
    map.change(
        4, 4, [by](int x, int y) { return test::townHeight(x, y) + by; }, false);
    ASSERT_TRUE(ram.poll().has_value());
    load();
  };
  for (int i = 0; i < 20; ++i) {
    rise(50);
    cache.update(focus, {.aside = true});  // begins the image
    rise(static_cast<float>(-20 - i));
    cache.update(focus, {});
    const auto newest = sink.bounds;
    const auto uploads = sink.order.size();
    std::this_thread::sleep_for(3ms);
    cache.update(focus, {.aside = true});
    ASSERT_EQ(sink.order.size(), uploads);
    ASSERT_EQ(sink.bounds, newest);
  }
}

TEST_F(ClipFixture, WhatIsDrawnNeverGetsCoarserThroughUpdates) {
  settle();
  std::map<std::pair<int, int>, int> before;
  for (int y = 0; y < map.texels(); y += 8)
    for (int x = 0; x < map.texels(); x += 8)
      before[{x, y}] = cache.finestAt((domain.minTexel() + Eigen::Vector2d(x, y)).cast<int>());
  sink.cost = 1ms;
  for (int frame = 0; frame < 60; ++frame) {
    map.change(frame % 8, (frame * 3) % 8, test::townHeight, frame % 2 == 0);
    ASSERT_TRUE(ram.poll().has_value());
    if (frame % 3 != 0) ram.loadNext(sink.time);
    const Clock::time_point begin = sink.time;
    cache.update(focus, {.time = 2ms});
    EXPECT_LE(sink.time - begin, 2ms);
    for (const auto& [at, level] : before)
      ASSERT_LE(cache.finestAt((domain.minTexel() + Eigen::Vector2d(at.first, at.second)).cast<int>()), level)
          << frame;
  }
}

TEST_F(ClipFixture, AHigherBuildingRaisesTheBoundsAboveItBeforeItsParentsAreMade) {
  settle();
  map.change(
      4, 4, [](int x, int y) { return test::townHeight(x, y) + 50; }, false);
  ASSERT_TRUE(ram.poll().has_value());
  load();
  cache.update(focus, {});
  expectBoundsHold();
  EXPECT_GT(cache.highest(), 490);
}

TEST_F(ClipFixture, AnErasedTileIsNoLongerDrawnAndItsParentIs) {
  settle();
  const Eigen::Vector2i at = middle.cast<int>();
  ASSERT_EQ(cache.finestAt(at), 0);
  const int size = domain.tileSize();
  map.erase(domain.key(0, at.x() / size, at.y() / size));
  ASSERT_TRUE(ram.poll().has_value());
  load();
  cache.update(focus, {});
  EXPECT_EQ(cache.finestAt(at), 1);
}

TEST_F(ClipFixture, HardExpiryTakesATileOffThePictureSoftExpiryDoesNot) {
  map.setLife(1s, 1s);
  settle();
  sink.time += 1500ms;
  cache.update(focus, {});
  EXPECT_EQ(cache.finestAt(middle.cast<int>()), 0);
  sink.time += 600ms;
  cache.update(focus, {});
  EXPECT_EQ(cache.finestAt(middle.cast<int>()), domain.levels() - 1);
  load();
  cache.update(focus, {});
  EXPECT_EQ(cache.finestAt(middle.cast<int>()), 0);
}

TEST(UploadBudgetTest, LeavesWhatDrawingDoesNotTakeAndAtLeastATwentieth) {
  UploadBudget budget(20ms);
  budget.drawn(5ms);
  EXPECT_EQ(budget.next(), 15ms);
  for (int i = 0; i < 50; ++i) budget.drawn(40ms);
  EXPECT_EQ(budget.next(), 1ms);
  for (int i = 0; i < 50; ++i) budget.drawn(2ms);
  EXPECT_GT(budget.next(), 17ms);
}

}  // namespace
}  // namespace overfly::preview
