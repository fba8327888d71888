// A tile is a function of its frame set: neither the order of arrival, nor repetition, nor what was mapped in
// between, nor a restart shows in a single bit.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "tests/stress/hard_case/hard_case.h"
#include "tests/stress/sweep/mapped_scene.h"

namespace overfly::test {
namespace {

class Order : public GlTest {
 protected:
  using Tiles = std::map<geo::TileKey, tiling::Tile>;

  // Frames in this order, mapped after every batch; the tiles that all frames together give.
  static Tiles mapIn(const MappedScene& scene, const std::vector<std::size_t>& order, std::size_t batch,
                     std::size_t restart_after = SIZE_MAX) {
    std::unique_ptr<tiling::Mapper> mapper = MappedScene::mapper(context());
    std::set<geo::TileKey> all;
    for (std::size_t n = 0; n < order.size(); ++n) {
      if (n == restart_after) {  // what was recorded is taken in again, by number
        mapper = MappedScene::mapper(context());
        std::vector<std::size_t> before(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(n));
        std::sort(before.begin(), before.end());
        for (const std::size_t i : before) (void)scene.add(*mapper, i);
      }
      const std::set<geo::TileKey> touched = scene.add(*mapper, order[n]);
      all.insert(touched.begin(), touched.end());
      if (batch > 0 && (n + 1) % batch == 0) {
        (void)mapper->balanceExposure();
        (void)MappedScene::finish(*mapper, touched);
      }
    }
    (void)mapper->balanceExposure();
    return MappedScene::finish(*mapper, all);
  }
  static double differentTiles(const Tiles& a, const Tiles& b) {
    std::size_t different = a.size() != b.size() ? 1 : 0;
    for (const auto& [key, tile] : a) {
      const auto other = b.find(key);
      different += other == b.end() || !(other->second == tile) ? 1 : 0;
    }
    return static_cast<double>(different);
  }
};

TEST_F(Order, AnyOrderBatchesRepeatsAndARestartGiveTheSameBits) {
  const MappedScene scene(hills(), 3, 2);
  std::vector<std::size_t> order(scene.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const Tiles reference = mapIn(scene, order, 0);
  ASSERT_GE(reference.size(), 4u);
  std::mt19937 random(static_cast<unsigned>(countFrom("OVERFLY_SEED", 11)));
  double shuffled = 0;
  for (int i = 0; i < countFrom("OVERFLY_ORDERS", 3); ++i) {
    std::shuffle(order.begin(), order.end(), random);
    shuffled += differentTiles(reference, mapIn(scene, order, 1 + random() % 5));
  }
  expectAtMost("order/any", "tiles that differ in a bit, frames in other orders and batches", shuffled, 0);
  std::vector<std::size_t> twice = order;
  twice.insert(twice.end(), order.begin(), order.end());
  expectAtMost("order/twice", "tiles that differ in a bit, every frame twice",
               differentTiles(reference, mapIn(scene, twice, 7)), 0);
  expectAtMost("order/restart", "tiles that differ in a bit, a restart half-way",
               differentTiles(reference, mapIn(scene, order, 4, order.size() / 2)), 0);
}

}  // namespace
}  // namespace overfly::test
