#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <map>
#include <set>

#include "tests/unit/store/store_fixture.h"

namespace overfly::tiling {
namespace {

class ChangesTest : public StoreTest {};

TEST_F(ChangesTest, CursorTextIsReadBack) {
  const ChangeCursor cursor{.since = 5, .until = 900, .zoom = 17, .revision = 12, .done = true};
  EXPECT_EQ(ChangeCursor::parse(cursor.text()).value(), cursor);
  EXPECT_EQ(ChangeCursor::parse("77").value(), ChangeCursor::after(77));
  for (const char* bad : {"", "x", "1.", "1.2", "1.2.3", "1.2.3.4.", "1.2.3.4.5", "-1", "1.2.64.4", "1..2.3",
                          "99999999999999999999", "18446744073709551615", "1.2.3.4.endx", " 1"})
    EXPECT_EQ(ChangeCursor::parse(bad).error().code, ErrorCode::BadInput) << bad;
}

TEST_F(ChangesTest, CoarseLevelsComeFirst) {
  auto store = MapStore::create(path(), {});
  Batch batch;
  batch.tiles = {tile(20, 0, 0, "a"), tile(20, 1, 0, "b"), tile(19, 0, 0, "p"), tile(18, 0, 0, "q")};
  ASSERT_TRUE(store->commit(batch));
  const auto page = store->reader()->changes({}, {.layers = only(Layer::Color)}, 100).value();
  std::vector<int> zooms;
  for (const Change& change : page.changes) zooms.push_back(change.key.zoom);
  EXPECT_EQ(zooms, (std::vector{18, 19, 20, 20}));
  EXPECT_TRUE(page.next.done);
}

TEST_F(ChangesTest, BoxLayersAndZoomsFilter) {
  auto store = MapStore::create(path(), {});
  Batch batch;
  for (int x = 0; x < 10; ++x) batch.tiles.push_back(tile(10, x, 0, "t"));
  batch.tiles.push_back(tile(9, 0, 0, "p"));
  ASSERT_TRUE(store->commit(batch));
  const auto reader = store->reader();
  const double cell = 1.0 / 1024;
  const auto boxed =
      reader
          ->changes({}, {.box = PlaneBox{2.5 * cell, 0.1 * cell, 4 * cell, 0.2 * cell}, .min_zoom = 10}, 100)
          .value();
  ASSERT_EQ(boxed.changes.size(), 4u) << "tiles 2 and 3, two layers each; a shared edge does not count";
  EXPECT_EQ(boxed.changes[0].key.x, 2);
  EXPECT_EQ(boxed.changes[3].key.x, 3);
  EXPECT_EQ(reader->changes({}, {.layers = only(Layer::Elevation), .max_zoom = 9}, 100)->changes.size(), 1u);
}

TEST_F(ChangesTest, ErasedLayersAreListedAsErased) {
  auto store = MapStore::create(path(), {});
  Batch batch;
  batch.tiles = {tile(20, 0, 0, "a")};
  const std::uint64_t before = store->commit(batch).value();
  batch.tiles[0].erase = true;
  ASSERT_TRUE(store->commit(batch));
  const auto page = store->reader()->changes(ChangeCursor::after(before), {}, 100).value();
  ASSERT_EQ(page.changes.size(), 2u);
  EXPECT_TRUE(page.changes[0].erased && page.changes[1].erased);
}

TEST_F(ChangesTest, ARevisionFromAnotherMapIsRefused) {
  auto store = MapStore::create(path(), {});
  EXPECT_EQ(store->reader()->changes(ChangeCursor::after(5), {}, 10).error().code, ErrorCode::BadInput);
}

TEST_F(ChangesTest, ByteBudgetAndLimitCutBetweenTiles) {
  auto store = MapStore::create(path(), {});
  Batch batch;
  for (int x = 0; x < 5; ++x) batch.tiles.push_back(tile(10, x, 0, std::string(100, 'x')));  // 201 bytes each
  ASSERT_TRUE(store->commit(batch));
  const auto reader = store->reader();
  auto page = reader->changes({}, {}, 100, 450).value();
  EXPECT_EQ(page.changes.size(), 4u);
  EXPECT_FALSE(page.next.done);
  page = reader->changes({}, {}, 100, 1).value();
  EXPECT_EQ(page.changes.size(), 2u) << "one tile always passes, else a client never gets on";
  page = reader->changes({}, {}, 3).value();
  EXPECT_EQ(page.changes.size(), 4u);
}

// A mirror that pulls pages of random size, through cursors as text, while the map goes on changing, ends
// with exactly the map, and gets no (tile, layer, revision) twice.
RC_GTEST_PROP(ChangesProperty, AMirrorEndsWithTheMap, ()) {
  const auto folder = testFolder("mirror");
  {
    auto store = MapStore::create(folder / "map.overfly", {});
    RC_ASSERT(store.has_value());
    const auto reader = store->reader();
    using Place = std::tuple<geo::TileKey, Layer>;
    std::map<Place, std::uint64_t> mirror;
    std::set<std::tuple<geo::TileKey, Layer, std::uint64_t>> sent;
    ChangeCursor cursor;
    int serial = 0;
    const auto write = [&] {
      Batch batch;
      for (int i = *rc::gen::inRange(1, 5); i > 0; --i) {
        TileWrite change;
        change.key = {*rc::gen::inRange(8, 11), *rc::gen::inRange(-2, 2), *rc::gen::inRange(-1, 2)};
        change.erase = *rc::gen::inRange(0, 8) == 0;
        for (const Layer which : {Layer::Color, Layer::Elevation})
          if (*rc::gen::arbitrary<bool>()) {
            const std::string bytes = std::to_string(++serial);
            change.layers.push_back({which, Codec::Planes, {bytes.begin(), bytes.end()}, {}});
          }
        batch.tiles.push_back(change);
      }
      RC_ASSERT(store->commit(batch).has_value());
    };
    const auto pull = [&] {
      if (cursor.done) cursor = ChangeCursor::after(cursor.until);
      const auto page = reader->changes(ChangeCursor::parse(cursor.text()).value(), {},
                                        *rc::gen::inRange<std::size_t>(1, 7));
      RC_ASSERT(page.has_value());
      for (const Change& change : page->changes) {
        RC_ASSERT(sent.emplace(change.key, change.layer, change.revision).second);
        if (change.erased)
          mirror.erase({change.key, change.layer});
        else
          mirror[{change.key, change.layer}] = change.revision;
      }
      cursor = page->next;
    };
    const int steps = *rc::gen::inRange(5, 25);
    for (int i = 0; i < steps; ++i) *rc::gen::arbitrary<bool>() ? write() : pull();
    for (int i = 0; i < 1000 && !(cursor.done && cursor.until == reader->revision().value()); ++i) pull();
    RC_ASSERT(cursor.done);

    std::map<Place, std::uint64_t> truth;
    for (int zoom = 8; zoom < 11; ++zoom)
      for (int x = -2; x < 2; ++x)
        for (int y = -1; y < 2; ++y)
          for (const Layer which : {Layer::Color, Layer::Elevation})
            if (const auto revision = reader->layerRevision({zoom, x, y}, which))
              truth[{{zoom, x, y}, which}] = *revision;
    RC_ASSERT(mirror == truth);
  }
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace overfly::tiling
