#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <thread>

#include "tests/unit/store/store_fixture.h"
#include "tiling/store/store_writer.h"
#include "tiling/store/tile_cache.h"
#include "tiling/store/tile_codec.h"
#include "tiling/store/tile_loader.h"

namespace overfly::tiling {
namespace {

TilePtr tileAt(std::int64_t x, int size = 16) {
  return std::make_shared<const Tile>(Tile::blank({20, x, 0}, size));
}

TEST(TileCache, TheLeastRecentlyUsedGoesFirstAndTheBudgetHolds) {
  const std::size_t one = TileCache::bytesOf(*tileAt(0));
  TileCache cache(3 * one);
  for (int x = 0; x < 3; ++x) cache.insert(tileAt(x), cache.ticket());
  EXPECT_TRUE(cache.find({20, 0, 0}));
  cache.insert(tileAt(3), cache.ticket());
  EXPECT_TRUE(cache.find({20, 0, 0}));
  EXPECT_FALSE(cache.find({20, 1, 0}));
  const TileCache::Counts counts = cache.counts();
  EXPECT_EQ(counts.evictions, 1u);
  EXPECT_EQ(counts.hits, 2u);
  EXPECT_EQ(counts.misses, 1u);
  EXPECT_EQ(counts.tiles, 3u);
  EXPECT_EQ(counts.bytes, 3 * one);
  cache.insert(tileAt(3), cache.ticket());
  EXPECT_EQ(cache.counts().bytes, 3 * one) << "replaced, not counted twice";
  cache.clear();
  EXPECT_EQ(cache.counts().bytes, 0u);
}

TEST(TileCache, ATileBeyondTheBudgetIsNotTakenIn) {
  TileCache cache(100);
  cache.insert(tileAt(0), cache.ticket());
  EXPECT_EQ(cache.counts().tiles, 0u);
}

TEST(TileCache, WhatWasReadBeforeAnInvalidationIsNotTakenInAfterIt) {
  TileCache cache(1 << 20);
  const std::uint64_t before = cache.ticket();
  cache.invalidate({20, 1, 0});
  cache.insert(tileAt(1), before);
  EXPECT_FALSE(cache.find({20, 1, 0}));
  cache.insert(tileAt(2), before);
  EXPECT_TRUE(cache.find({20, 2, 0})) << "another tile is none the worse";
  cache.insert(tileAt(1), cache.ticket());
  EXPECT_TRUE(cache.find({20, 1, 0}));
  for (int i = 0; i < 10000; ++i) cache.invalidate({19, i, 0});
  cache.insert(tileAt(4), before);
  EXPECT_FALSE(cache.find({20, 4, 0})) << "a ticket that is too old to be judged is refused";
}

class TileLoaderTest : public StoreTest {
 protected:
  static Tile flat(std::int64_t x, float height) {
    Tile tile = Tile::blank({20, x, 0}, 16);
    for (float& value : tile.elevation) value = height;
    return tile;
  }
  static Batch batchOf(std::int64_t x, float height) {
    Batch batch;
    batch.tiles = {encodeTile(flat(x, height), {}).value()};
    return batch;
  }
};

// Readers through the cache, while the tile is rewritten: after a commit was acknowledged, nobody is given
// an older tile.
TEST_F(TileLoaderTest, ACommittedTileIsNeverFollowedByAnOlderOne) {
  MapMeta meta;
  meta.tile_size = 16;
  auto store = MapStore::create(path(), meta);
  ASSERT_TRUE(store) << store.error().message;
  TileCache cache(1 << 20);
  StoreWriter writer(std::move(*store), {});
  writer.addListener([&](std::uint64_t, const std::vector<geo::TileKey>& keys) {
    for (const geo::TileKey& key : keys) cache.invalidate(key);
  });
  TileLoader loader([&] { return writer.reader(); }, cache, 2);
  std::atomic<int> acknowledged = 0, older = 0, loads = 0;
  {
    std::vector<std::jthread> clients;
    for (int i = 0; i < 2; ++i)
      clients.emplace_back([&](const std::stop_token& stop) {
        while (!stop.stop_requested()) {
          const int expected = acknowledged;
          std::promise<float> height;
          loader.load({20, 0, 0}, [&](const Result<TilePtr>& tile) {
            height.set_value(tile ? (*tile)->elevation[0] : 0.0F);
          });
          // A request that joined a read begun before the commit gets that read's tile: one version older.
          if (height.get_future().get() < static_cast<float>(expected - 1)) ++older;
          ++loads;
        }
      });
    for (int version = 1; version <= 300; ++version) {
      ASSERT_TRUE(writer.submit(batchOf(0, static_cast<float>(version)))->get());
      acknowledged = version;
    }
  }
  EXPECT_EQ(older, 0);
  EXPECT_GT(loads, 0);
  std::promise<Result<TilePtr>> last;
  loader.load({20, 0, 0}, [&](const Result<TilePtr>& tile) { last.set_value(tile); });
  EXPECT_EQ((*last.get_future().get())->elevation[0], 300.0F);
  std::promise<Result<TilePtr>> missing;
  loader.load({20, 9, 9}, [&](const Result<TilePtr>& tile) { missing.set_value(tile); });
  EXPECT_EQ(missing.get_future().get().error().code, ErrorCode::NotFound);
}

TEST_F(TileLoaderTest, WaitingBatchesShareCommitsAndKeepTheirOrder) {
  MapMeta meta;
  meta.tile_size = 16;
  auto store = MapStore::create(path(), meta);
  StoreWriter writer(std::move(*store), {});
  std::vector<std::future<Result<std::uint64_t>>> done;
  for (int i = 0; i < 502; ++i) {
    Batch batch = batchOf(i % 7, static_cast<float>(i));
    batch.enqueue = {{{20, i % 7, 0}, 1, static_cast<double>(i), ""}};
    if (i % 7 == 3) batch.dequeue = {{{20, 2, 0}, 1}};  // what the batch before put in
    done.push_back(std::move(*writer.submit(std::move(batch))));
  }
  Batch bad;
  bad.tiles.resize(1);
  bad.tiles[0].key.zoom = -1;
  auto refused = std::move(*writer.submit(std::move(bad)));
  auto after = std::move(*writer.submit(batchOf(8, 8)));
  std::uint64_t last = 0;
  for (auto& future : done) {
    const Result<std::uint64_t> revision = future.get();
    ASSERT_TRUE(revision) << revision.error().message;
    EXPECT_GE(*revision, last);
    last = *revision;
  }
  EXPECT_EQ(refused.get().error().code, ErrorCode::BadInput);
  EXPECT_TRUE(after.get()) << "a bad batch takes none of its group with it";
  ASSERT_TRUE(writer.flush(std::chrono::seconds(5)));
  const StoreWriter::Status status = writer.status();
  EXPECT_EQ(status.batches, 503u);
  EXPECT_EQ(status.waiting_batches, 0u);
  EXPECT_LT(status.commits, 503u);
  const auto reader = writer.reader();
  for (int x = 0; x < 7; ++x) {
    const float newest = static_cast<float>(501 - (501 - x) % 7);
    EXPECT_EQ(readTile(*reader, {20, x, 0})->elevation[0], newest) << x;
  }
  EXPECT_EQ(reader->queue()->size(), 6u);
}

}  // namespace
}  // namespace overfly::tiling
