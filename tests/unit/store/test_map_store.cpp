#include <gmock/gmock.h>

#include <fstream>
#include <thread>

#include "tests/unit/store/store_fixture.h"

namespace overfly::tiling {
namespace {

using testing::HasSubstr;

TEST_F(StoreTest, AMapIsTheSameAfterReopening) {
  MapMeta meta;
  meta.name = "north meadow";
  meta.lattice = "webmercator";
  meta.datum = capture::VerticalDatum::Geoid;
  meta.geoid = "egm96";
  meta.tile_size = 512;
  meta.base_zoom = 21;
  meta.elevation_step_m = 0.02;
  meta.extra = R"({"mission":7})";
  std::string id;
  {
    auto store = MapStore::create(path(), meta);
    ASSERT_TRUE(store) << store.error().message;
    id = store->meta().id;
    EXPECT_EQ(id.size(), 32u);
    Batch batch;
    batch.tiles = {tile(21, 5, -3, "abc")};
    batch.values = {{"mission", "7"}};
    ASSERT_EQ(store->commit(batch).value(), 1u);
  }
  const auto reader = MapReader::open(path());
  ASSERT_TRUE(reader) << reader.error().message;
  const MapMeta back = reader->meta().value();
  EXPECT_EQ(back.id, id);
  EXPECT_EQ(back.name, meta.name);
  EXPECT_EQ(back.datum, meta.datum);
  EXPECT_EQ(back.geoid, meta.geoid);
  EXPECT_EQ(back.tile_size, 512);
  EXPECT_EQ(back.base_zoom, 21);
  EXPECT_DOUBLE_EQ(back.elevation_step_m, 0.02);
  EXPECT_EQ(back.extra, meta.extra);
  EXPECT_EQ(reader->revision().value(), 1u);
  const auto color = reader->read({21, 5, -3}, Layer::Color);
  ASSERT_TRUE(color) << color.error().message;
  EXPECT_EQ(text(*color), "abc");
  EXPECT_EQ(color->revision, 1u);
  EXPECT_EQ(color->encoded.statistics, (LayerStatistics{1, 2, 3}));
  EXPECT_EQ(reader->value("mission").value(), "7");
  EXPECT_EQ(reader->value("nothing").error().code, ErrorCode::NotFound);
}

TEST_F(StoreTest, ATileThatWasNeverStoredIsNotFound) {
  const auto store = MapStore::create(path(), {});
  const auto reader = store->reader();
  EXPECT_EQ(reader->read({3, 1, 1}, Layer::Color).error().code, ErrorCode::NotFound);
  EXPECT_EQ(reader->info({3, 1, 1}).error().code, ErrorCode::NotFound);
  EXPECT_EQ(reader->bounds(Layer::Color).error().code, ErrorCode::NotFound);
  EXPECT_EQ(reader->readTop(kAllLayers).error().code, ErrorCode::NotFound);
}

TEST_F(StoreTest, EveryChangedTileGetsTheNextRevisionAndAnUnchangedOneKeepsIts) {
  auto store = MapStore::create(path(), {});
  Batch batch;
  batch.tiles = {tile(20, 0, 0, "a"), tile(20, 1, 0, "b"), tile(19, 0, 0, "p")};
  ASSERT_EQ(store->commit(batch).value(), 3u);
  const auto reader = store->reader();
  EXPECT_EQ(reader->read({20, 0, 0}, Layer::Color)->revision, 1u);
  EXPECT_EQ(reader->read({20, 1, 0}, Layer::Color)->revision, 2u);
  EXPECT_EQ(reader->read({19, 0, 0}, Layer::Color)->revision, 3u);
  batch.tiles[1].layers[0] = layer(Layer::Color, "B");
  ASSERT_EQ(store->commit(batch).value(), 4u);
  EXPECT_EQ(reader->read({20, 0, 0}, Layer::Color)->revision, 1u);
  EXPECT_EQ(reader->read({20, 1, 0}, Layer::Color)->revision, 4u);
  EXPECT_EQ(reader->read({20, 1, 0}, Layer::Elevation)->revision, 2u);
  EXPECT_EQ(reader->info({20, 1, 0})->revision, 4u);
}

TEST_F(StoreTest, ALayerThatIsNotNamedKeepsWhatItHas) {
  auto store = MapStore::create(path(), {});
  Batch first;
  first.tiles = {tile(20, 0, 0, "a")};
  ASSERT_TRUE(store->commit(first));
  Batch second;
  second.tiles.resize(1);
  second.tiles[0].key = {20, 0, 0};
  second.tiles[0].layers = {layer(Layer::Quality, "q")};
  second.tiles[0].frame_set = {9, 3, 9, 1ull << 40};
  second.tiles[0].gsd_m = 0.05F;
  second.tiles[0].provisional = true;
  ASSERT_TRUE(store->commit(second));
  const auto reader = store->reader();
  EXPECT_EQ(text(*reader->read({20, 0, 0}, Layer::Color)), "a");
  EXPECT_EQ(reader->readWhole({20, 0, 0}, kAllLayers)->layers.size(), 3u);
  EXPECT_EQ(reader->readWhole({20, 0, 0}, only(Layer::Quality) | only(Layer::State))->layers.size(), 1u);
  const TileInfo info = reader->info({20, 0, 0}).value();
  EXPECT_EQ(info.frame_set, (std::vector<std::uint64_t>{3, 9, 1ull << 40}));
  EXPECT_EQ(info.layers, only(Layer::Color) | only(Layer::Elevation) | only(Layer::Quality));
  EXPECT_FLOAT_EQ(info.gsd_m, 0.05F);
  EXPECT_TRUE(info.provisional);
}

TEST_F(StoreTest, ExtentsFollowGrowthInAllDirectionsAndErasure) {
  MapMeta meta;
  meta.base_zoom = 10;
  auto store = MapStore::create(path(), meta);
  Batch batch;
  batch.tiles = {tile(10, -3, -4, "a"), tile(10, 5, 6, "bb"), tile(9, -2, -2, "p")};
  ASSERT_TRUE(store->commit(batch));
  const auto reader = store->reader();
  const double cell = 1.0 / 1024;
  EXPECT_EQ(reader->bounds(Layer::Color).value(), (PlaneBox{-3 * cell, -4 * cell, 6 * cell, 7 * cell}));
  EXPECT_EQ(reader->zoomRange(Layer::Color).value(), (std::pair{9, 10}));
  StoreStatistics statistics = reader->statistics().value();
  EXPECT_EQ(statistics.tiles, 3u);
  ASSERT_EQ(statistics.levels.size(), 4u);
  EXPECT_EQ(statistics.levels[1].bytes, 3u);
  EXPECT_EQ(statistics.levels[1].tiles, 2u);

  Batch erase;
  erase.tiles.resize(1);
  erase.tiles[0].key = {10, 5, 6};
  erase.tiles[0].erase = true;
  ASSERT_EQ(store->commit(erase).value(), 4u);
  EXPECT_EQ(reader->read({10, 5, 6}, Layer::Color).error().code, ErrorCode::NotFound);
  EXPECT_EQ(reader->bounds(Layer::Color).value(), (PlaneBox{-3 * cell, -4 * cell, -2 * cell, -3 * cell}));
  statistics = reader->statistics().value();
  EXPECT_EQ(statistics.tiles, 2u);
  EXPECT_EQ(statistics.levels[1].bytes, 1u);
  erase.tiles[0].key = {10, -3, -4};
  ASSERT_TRUE(store->commit(erase));
  EXPECT_EQ(reader->zoomRange(Layer::Color).value(), (std::pair{9, 9}));
}

TEST_F(StoreTest, TheTopTileIsKeyedApartAndReplacedWhenItMoves) {
  auto store = MapStore::create(path(), {});
  Batch batch;
  batch.tiles = {tile(17, 8, 9, "lattice"), tile(17, 8, 9, "top")};
  batch.tiles[1].top = true;
  ASSERT_TRUE(store->commit(batch));
  const auto reader = store->reader();
  EXPECT_EQ(text(*reader->read({17, 8, 9}, Layer::Color)), "lattice");
  EXPECT_EQ(text(reader->readTop(only(Layer::Color)).value().layers.at(0)), "top");
  batch.tiles = {tile(16, 3, 3, "higher")};
  batch.tiles[0].top = true;
  ASSERT_TRUE(store->commit(batch));
  EXPECT_EQ(reader->readTop(kAllLayers)->info.key, (geo::TileKey{16, 3, 3}));
  EXPECT_EQ(text(reader->readTop(only(Layer::Color)).value().layers.at(0)), "higher");
  EXPECT_EQ(reader->read({16, 3, 3}, Layer::Color).error().code, ErrorCode::NotFound);
  const auto page = reader->changes({}, {}, 100).value();
  EXPECT_EQ(page.changes.size(), 2u) << "the top tile is not listed";
}

TEST_F(StoreTest, FramesAndQueueAreKeptWhole) {
  FrameRecord frame;
  frame.id = 42;
  frame.name = "DJI_0042.JPG";
  frame.camera_id = "main";
  frame.camera.kind = capture::CameraModel::Kind::Fisheye;
  frame.camera.width = 4000;
  frame.camera.height = 3000;
  frame.camera.fx = 2100.123456789012345;
  frame.camera.distortion = {0.1, -0.2, 1e-17, 3};
  frame.pose.emplace();
  frame.pose->time_ns = 123456789012345678;
  frame.pose->position_in_ecef = {4e6 + 1e-9, -1.5, 4.8e6};
  frame.pose->ecef_from_camera = Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5);
  frame.pose->covariance(2, 5) = 7;
  frame.pose_is_adjusted = true;
  frame.datum = capture::VerticalDatum::Home;
  frame.time_ns = 11;
  frame.utc_offset_ns = -12;
  frame.exposure_ns = 13;
  frame.footprint.emplace();
  frame.footprint->corners[3].lon = 1.25;
  frame.footprint->gsd_m = 0.04;
  frame.footprint->tilt = 0.1;
  frame.box = PlaneBox{0.1, 0.2, 0.3, 0.4};
  frame.path = "frames/42.jpg";
  frame.bytes = 999;
  frame.state = FrameState::Refused;
  frame.reason = "blurred";
  FrameRecord bare;
  bare.id = 7;
  auto store = MapStore::create(path(), {});
  Batch batch;
  batch.frames = {frame, bare};
  batch.enqueue = {{{20, 1, 2}, 1, 0.5, "why"}, {{20, 1, 2}, 2, 0.25, ""}};
  ASSERT_EQ(store->commit(batch).value(), 0u) << "frames alone change no tile";
  const auto reader = store->reader();
  const FrameRecord back = reader->frame(42).value();
  EXPECT_EQ(back.name, frame.name);
  EXPECT_EQ(back.camera, frame.camera);
  EXPECT_EQ(back.pose->position_in_ecef, frame.pose->position_in_ecef);
  EXPECT_EQ(back.pose->ecef_from_camera.coeffs(), frame.pose->ecef_from_camera.coeffs());
  EXPECT_EQ(back.pose->covariance, frame.pose->covariance);
  EXPECT_EQ(back.pose->time_ns, frame.pose->time_ns);
  EXPECT_TRUE(back.pose_is_adjusted);
  EXPECT_EQ(back.datum, frame.datum);
  EXPECT_EQ(back.utc_offset_ns, -12);
  EXPECT_EQ(back.footprint->corners[3].lon, 1.25);
  EXPECT_EQ(back.footprint->tilt, 0.1);
  EXPECT_EQ(back.box, frame.box);
  EXPECT_EQ(back.state, FrameState::Refused);
  EXPECT_EQ(back.reason, "blurred");
  ASSERT_EQ(reader->frames()->size(), 2u);
  EXPECT_FALSE(reader->frame(7)->pose);
  EXPECT_FALSE(reader->frame(7)->box);
  EXPECT_EQ(reader->frames(7)->size(), 1u);
  EXPECT_EQ(reader->frame(8).error().code, ErrorCode::NotFound);
  EXPECT_EQ(reader->statistics()->frame_bytes, 999u);
  ASSERT_EQ(reader->queue()->size(), 2u);
  Batch done;
  done.dequeue = {{{20, 1, 2}, 1}};
  ASSERT_TRUE(store->commit(done));
  ASSERT_EQ(reader->queue()->size(), 1u);
  EXPECT_EQ(reader->queue()->at(0).kind, 2);
}

TEST_F(StoreTest, ListenersHearOfTheNewRevisionAfterItIsThere) {
  auto store = MapStore::create(path(), {});
  std::uint64_t heard = 0, stored = 0;
  const auto reader = store->reader();
  const int handle = store->addListener([&](std::uint64_t revision, const std::vector<geo::TileKey>& tiles) {
    heard = revision;
    stored = reader->revision().value();
    EXPECT_EQ(tiles.size(), 2u);
  });
  Batch batch;
  batch.tiles = {tile(20, 0, 0, "a"), tile(20, 1, 0, "b")};
  ASSERT_TRUE(store->commit(batch));
  EXPECT_EQ(heard, 2u);
  EXPECT_EQ(stored, 2u);
  store->removeListener(handle);
  batch.tiles = {tile(20, 0, 0, "c")};
  ASSERT_TRUE(store->commit(batch));
  EXPECT_EQ(heard, 2u);
}

TEST_F(StoreTest, ABatchWithOneBadTileLeavesNothingBehind) {
  auto store = MapStore::create(path(), {});
  Batch batch;
  batch.tiles = {tile(20, 0, 0, "a"), tile(-1, 0, 0, "b")};
  EXPECT_EQ(store->commit(batch).error().code, ErrorCode::BadInput);
  const auto reader = store->reader();
  EXPECT_EQ(reader->revision().value(), 0u);
  EXPECT_EQ(reader->read({20, 0, 0}, Layer::Color).error().code, ErrorCode::NotFound);
  batch.tiles.pop_back();
  EXPECT_EQ(store->commit(batch).value(), 1u);
}

TEST_F(StoreTest, MeaningCanBeAmendedOnlyBeforeTheFirstTile) {
  auto store = MapStore::create(path(), {});
  MapMeta meta = store->meta();
  meta.base_zoom = 20;
  ASSERT_TRUE(store->amend(meta));
  Batch batch;
  batch.tiles = {tile(20, 0, 0, "a")};
  ASSERT_TRUE(store->commit(batch));
  meta.name = "new name";
  EXPECT_TRUE(store->amend(meta));
  meta.base_zoom = 21;
  EXPECT_EQ(store->amend(meta).error().code, ErrorCode::BadInput);
  EXPECT_EQ(store->reader()->meta()->base_zoom, 20);
  EXPECT_EQ(store->reader()->meta()->name, "new name");
}

TEST_F(StoreTest, BadMetadataIsRefused) {
  MapMeta meta;
  meta.tile_size = 300;
  EXPECT_EQ(MapStore::create(path(), meta).error().code, ErrorCode::BadInput);
  meta = {};
  meta.lattice = "flat earth";
  EXPECT_FALSE(MapStore::create(path(), meta));
  EXPECT_FALSE(std::filesystem::exists(path()));
}

TEST_F(StoreTest, AnExistingFileIsNeverOverwritten) {
  ASSERT_TRUE(MapStore::create(path(), {}));
  EXPECT_THAT(MapStore::create(path(), {}).error().message, HasSubstr("is a map already"));
  const auto other = folder_ / "notes.txt";
  std::ofstream(other) << "hello";
  EXPECT_EQ(MapStore::create(other, {}).error().code, ErrorCode::BadInput);
  EXPECT_EQ(MapStore::open(other).error().code, ErrorCode::BadInput);
  EXPECT_EQ(std::filesystem::file_size(other), 5u);
  EXPECT_EQ(MapStore::open(folder_).error().code, ErrorCode::BadInput);
  EXPECT_EQ(MapReader::open(folder_ / "absent").error().code, ErrorCode::NotFound);
}

TEST_F(StoreTest, TheRestOfAKilledCreationIsTakenOver) {
  std::ofstream(path()).flush();
  std::ofstream(path().string() + ".new") << "half a file";
  EXPECT_THAT(MapStore::open(path()).error().message, HasSubstr("is empty"));
  EXPECT_TRUE(MapStore::create(path(), {}));
  EXPECT_FALSE(std::filesystem::exists(path().string() + ".new"));
}

TEST_F(StoreTest, AMapOnAMediumThatCannotBeWrittenIsRead) {
  {
    auto store = MapStore::create(path(), {});
    Batch batch;
    batch.tiles = {tile(20, 0, 0, "a")};
    ASSERT_TRUE(store->commit(batch));
  }
  EXPECT_FALSE(std::filesystem::exists(path().string() + "-wal"));
  if (geteuid() == 0) GTEST_SKIP() << "root writes everywhere";
  std::filesystem::permissions(folder_,
                               std::filesystem::perms::owner_read | std::filesystem::perms::owner_exec);
  const auto reader = MapReader::open(path());
  std::filesystem::permissions(folder_, std::filesystem::perms::owner_all);
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_TRUE(reader->read({20, 0, 0}, Layer::Color));
}

TEST_F(StoreTest, ReadersInOtherThreadsSeeWholeBatches) {
  auto store = MapStore::create(path(), {});
  std::atomic<bool> stop = false;
  std::atomic<int> torn = 0, seen = 0;
  std::vector<std::jthread> threads;
  for (int i = 0; i < 3; ++i)
    threads.emplace_back([&, reader = store->reader()] {
      while (!stop) {
        const auto whole = reader->readWhole({20, 0, 0}, kAllLayers);
        if (!whole) continue;
        ++seen;
        if (whole->layers.size() != 2 || text(whole->layers[0]) + "h" != text(whole->layers[1])) ++torn;
      }
    });
  for (int i = 0; i < 200; ++i) {
    Batch batch;
    batch.tiles = {tile(20, 0, 0, std::to_string(i) + std::string(9000, 'x'))};
    ASSERT_TRUE(store->commit(batch));
  }
  stop = true;
  threads.clear();
  EXPECT_EQ(torn, 0);
  EXPECT_GT(seen, 0);
}

}  // namespace
}  // namespace overfly::tiling
