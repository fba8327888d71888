#include <gmock/gmock.h>

#include <random>
#include <set>

#include "daemon/pull/want_list.h"

namespace overfly::pull {
namespace {

using testing::ElementsAre;
using tiling::Layer;

LayerKey colour(int zoom, std::int64_t x = 0, std::int64_t y = 0) { return {{zoom, x, y}, Layer::Color}; }
Listed listed(const LayerKey& what, std::uint64_t revision, std::uint32_t bytes = 1000) {
  return {what, revision, bytes};
}
std::vector<LayerKey> keys(const std::vector<Listed>& all) {
  std::vector<LayerKey> out;
  for (const auto& one : all) out.push_back(one.what);
  return out;
}

TEST(WantList, CoarseComesBeforeFineAndColourBeforeHeights) {
  WantList wants;
  const LayerKey heights{{16, 0, 0}, Layer::Elevation};
  wants.addPage("c",
                {listed(colour(18), 3), listed(heights, 2), listed(colour(17), 4), listed(colour(16), 2)});
  EXPECT_THAT(keys(wants.take(100'000, 9)), ElementsAre(colour(16), heights, colour(17), colour(18)));
}

TEST(WantList, WhatIsLookedAtComesFirstWithItsAncestors) {
  WantList wants;
  wants.addPage("c", {listed(colour(16, 1, 1), 1), listed(colour(16, 0, 0), 1), listed(colour(18, 5, 5), 1),
                      listed(colour(18, 0, 0), 1)});
  wants.lookAt({{17, 2, 2}});
  EXPECT_THAT(keys(wants.take(2000, 2)), ElementsAre(colour(16, 1, 1), colour(18, 5, 5)));
  wants.lookAt({});
  EXPECT_THAT(keys(wants.take(1, 1)), ElementsAre(colour(16, 0, 0)));
}

TEST(WantList, ACursorIsKeptOnlyWhenAllBeforeItIsThere) {
  WantList wants;
  wants.addPage("one", {listed(colour(16), 1), listed(colour(17), 2)});
  wants.addPage("two", {listed(colour(18), 3)});
  const auto all = wants.take(100'000, 9);
  ASSERT_EQ(all.size(), 3u);
  wants.done(colour(18), 3, 1000);
  EXPECT_FALSE(wants.cursor()) << "the first page is still open";
  wants.done(colour(16), 1, 1000);
  wants.giveBack(colour(17));
  EXPECT_FALSE(wants.cursor());
  (void)wants.take(1, 1);
  wants.done(colour(17), 2, 1000);
  EXPECT_EQ(wants.cursor(), "two");
  EXPECT_FALSE(wants.cursor());
  wants.addPage("empty", {});
  EXPECT_EQ(wants.cursor(), "empty");
}

TEST(WantList, WhatIsThereIsNotWantedAgain) {
  WantList wants;
  wants.have(colour(16), 5);
  wants.addPage("c", {listed(colour(16), 5)});
  EXPECT_EQ(wants.waiting(), 0u);
  EXPECT_EQ(wants.cursor(), "c");
  wants.add(listed(colour(16), 4));
  EXPECT_EQ(wants.waiting(), 0u);
  wants.add(listed(colour(16), 6));
  EXPECT_EQ(wants.waiting(), 1u);
}

TEST(WantList, ALiveOverviewNeitherStarvesTheRestNorGoesStale) {
  WantList wants;
  std::vector<Listed> page;
  for (int i = 0; i < 300; ++i) page.push_back(listed(colour(18, i), 10));
  wants.have(colour(14), 1);
  wants.addPage("c", page);
  std::uint64_t revision = 20;
  int overview = 0, fine = 0;
  for (int i = 0; i < 200; ++i) {
    wants.add(listed(colour(14), ++revision));  // every frame changes it
    for (const auto& one : wants.take(1, 1)) {
      wants.done(one.what, one.revision, 1000);
      ++(one.what.key.zoom == 14 ? overview : fine);
    }
  }
  EXPECT_NEAR(overview, 200 / 3, 3);
  EXPECT_NEAR(fine, 400 / 3, 3);
}

TEST(WantList, ATileThatCameOlderThanListedIsAskedForOnceMore) {
  WantList wants;
  wants.add(listed(colour(16), 4));
  (void)wants.take(1, 1);
  wants.addPage("c", {listed(colour(16), 9)});
  wants.done(colour(16), 4, 1000);
  EXPECT_FALSE(wants.cursor());
  ASSERT_EQ(wants.take(1, 1).size(), 1u);
  wants.done(colour(16), 4, 1000);  // a drone that never has it must not keep the mirror busy for ever
  EXPECT_EQ(wants.waiting(), 0u);
  EXPECT_EQ(wants.cursor(), "c");
}

// Any order of lists, events, losses and arrivals: everything comes, the last cursor is reached, and never
// before what stands before it.
TEST(WantList, NothingIsLostInAnyOrder) {
  for (unsigned seed = 1; seed <= 200; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    const auto pick = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
    WantList wants;
    std::map<LayerKey, std::uint64_t> drone, mirror;
    std::vector<std::map<LayerKey, std::uint64_t>> before;  // what must be there at cursor i
    std::uint64_t revision = 0;
    std::set<LayerKey> flying;
    int pages = 0;
    for (int step = 0; step < 400 || wants.waiting() + flying.size() > 0; ++step) {
      const int what = step < 400 ? pick(6) : 3 + pick(2);
      const auto key = colour(14 + pick(3), pick(4));
      if (what == 0) drone[key] = ++revision;
      if (what == 1 && !drone.empty()) {
        std::vector<Listed> page;
        for (const auto& [k, r] : drone)
          if (pick(2) == 0) page.push_back(listed(k, r));
        wants.addPage(std::to_string(pages++), page);
        auto needed = before.empty() ? std::map<LayerKey, std::uint64_t>{} : before.back();
        for (const auto& one : page) needed[one.what] = std::max(needed[one.what], one.revision);
        before.push_back(std::move(needed));
      }
      if (what == 2 && drone.contains(key)) wants.add(listed(key, drone[key]));
      if (what == 3)
        for (const auto& one : wants.take(2500, 4)) flying.insert(one.what);
      if (what >= 4 && !flying.empty()) {
        const auto one = *std::next(flying.begin(), pick(static_cast<int>(flying.size())));
        flying.erase(one);
        if (step < 400 && pick(3) == 0) {
          wants.giveBack(one);
        } else {
          mirror[one] = drone[one];
          wants.done(one, drone[one], 1000);
        }
      }
      if (const auto cursor = wants.cursor()) {
        // What changed again since is in a later part of the list, which is read from this cursor.
        for (const auto& [k, r] : before[static_cast<std::size_t>(std::stoi(*cursor))]) {
          EXPECT_TRUE(mirror[k] >= r || drone[k] > r) << mirror[k] << " of " << r;
        }
      }
      ASSERT_LT(step, 5000);
    }
    EXPECT_FALSE(wants.pagesOpen());
  }
}

}  // namespace
}  // namespace overfly::pull
