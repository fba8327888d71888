#include <fstream>

#include "tests/unit/store/store_fixture.h"
#include "tiling/store/retention.h"

namespace overfly::tiling {
namespace {

class RetentionTest : public StoreTest {
 protected:
  void SetUp() override {
    StoreTest::SetUp();
    store_.emplace(MapStore::create(path(), {}).value());
  }
  // A frame of 10 MB over the ground [x, x + 1), not really of that size.
  FrameRecord frame(std::uint64_t id, double x, FrameState state = FrameState::Mapped) {
    FrameRecord record;
    record.id = id;
    record.time_ns = static_cast<std::int64_t>(id);
    record.box = PlaneBox{x, 0, x + 1, 1};
    record.path = "frames/" + std::to_string(id) + ".jpg";
    record.bytes = 10'000'000;
    record.state = state;
    std::filesystem::create_directories(folder_ / "frames");
    std::ofstream(folder_ / record.path) << "image";
    return record;
  }
  [[nodiscard]] std::vector<std::uint64_t> dropped(std::uint64_t budget) const {
    std::vector<std::uint64_t> ids;
    const auto plan = planRetention(*store_->reader(), folder_, budget);
    for (const FrameRecord& record : plan->batch.frames) ids.push_back(record.id);
    return ids;
  }
  std::optional<MapStore> store_;
};

TEST_F(RetentionTest, RefusedFramesThenTheBestCoveredThenTheOldest) {
  Batch batch;
  // 1, 2, 3 lie on one spot; 4 is alone; 5 waits to be mapped; 6 was refused.
  batch.frames = {frame(1, 0),
                  frame(2, 0.1),
                  frame(3, 0.2),
                  frame(4, 7),
                  frame(5, 0, FrameState::Recorded),
                  frame(6, 20, FrameState::Refused)};
  ASSERT_TRUE(store_->commit(batch));
  EXPECT_TRUE(dropped(100'000'000).empty());
  EXPECT_EQ(dropped(52'000'000), (std::vector<std::uint64_t>{6}));
  EXPECT_EQ(dropped(32'000'000), (std::vector<std::uint64_t>{6, 1, 2}));
  EXPECT_EQ(dropped(1), (std::vector<std::uint64_t>{6, 1, 2, 3, 4})) << "never one that waits";
}

TEST_F(RetentionTest, AfterAPlanIsCarriedOutTheBudgetHolds) {
  Batch batch;
  batch.frames = {frame(1, 0), frame(2, 0)};
  batch.tiles = {tile(20, 0, 0, "kept")};
  batch.tiles[0].layers.push_back(layer(Layer::State, std::string(500000, 's')));
  batch.tiles[0].frame_set = {1, 2};
  ASSERT_TRUE(store_->commit(batch));
  ASSERT_TRUE(store_->checkpoint());
  const auto reader = store_->reader();
  auto plan = planRetention(*reader, folder_, 200'000).value();
  EXPECT_EQ(plan.files.size(), 2u);
  EXPECT_EQ(plan.batch.tiles.size(), 1u);
  EXPECT_EQ(plan.still_over_bytes, 0u);
  ASSERT_TRUE(removeFiles(plan));
  ASSERT_TRUE(removeFiles(plan)) << "a file that is gone is fine";
  EXPECT_FALSE(std::filesystem::exists(folder_ / "frames/1.jpg"));
  ASSERT_TRUE(store_->commit(plan.batch));
  ASSERT_TRUE(store_->checkpoint());
  EXPECT_EQ(reader->frame(1)->state, FrameState::Dropped);
  EXPECT_EQ(reader->read({20, 0, 0}, Layer::State).error().code, ErrorCode::NotFound);
  EXPECT_EQ(text(*reader->read({20, 0, 0}, Layer::Color)), "kept");
  EXPECT_EQ(reader->info({20, 0, 0})->frame_set.size(), 2u);
  plan = planRetention(*reader, folder_, 200'000).value();
  EXPECT_LE(plan.used_bytes, 200'000u);
  EXPECT_TRUE(plan.files.empty());
  EXPECT_GT(planRetention(*reader, folder_, 100)->still_over_bytes, 0u) << "said, not deleted";
}

}  // namespace
}  // namespace overfly::tiling
