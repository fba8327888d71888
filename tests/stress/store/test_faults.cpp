#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <filesystem>
#include <random>
#include <thread>

#include "tests/stress/store/fault_vfs.h"
#include "tests/stress/store/parameters.h"
#include "tiling/store/map_store.h"
#include "tiling/store/store_writer.h"

namespace overfly::tiling {
namespace {

using Fault = FaultVfs::Fault;

// Tile x of version n: the layers' bytes say so, and both layers are of one batch.
TileWrite tile(int x, std::uint64_t version, std::size_t bytes = 3000) {
  TileWrite write;
  write.key = {20, x, 0};
  for (const Layer layer : {Layer::Color, Layer::Elevation}) {
    std::string text = std::to_string(version) + ":" + std::to_string(x) + ":";
    text.resize(bytes, static_cast<char>('a' + version % 26));
    write.layers.push_back({layer, Codec::Planes, {text.begin(), text.end()}, {}});
  }
  return write;
}

Batch batchOf(std::uint64_t version, int tiles = 4) {
  Batch batch;
  for (int x = 0; x < tiles; ++x) batch.tiles.push_back(tile(x, version));
  batch.values = {{"version", std::to_string(version)}};
  return batch;
}

// Every tile is whole and of the batch that the map says was last.
void expectWhole(const MapReader& reader, std::uint64_t version, int tiles = 4) {
  for (int x = 0; x < tiles; ++x) {
    const auto whole = reader.readWhole({20, x, 0}, kAllLayers);
    if (version == 0) {
      ASSERT_EQ(whole.error().code, ErrorCode::NotFound);
      continue;
    }
    ASSERT_TRUE(whole) << whole.error().message;
    const TileWrite expected = tile(x, version);
    ASSERT_EQ(whole->layers.size(), 2u);
    for (std::size_t i = 0; i < 2; ++i) ASSERT_EQ(whole->layers[i].encoded.bytes, expected.layers[i].bytes);
  }
  EXPECT_EQ(reader.revision().value(), version * static_cast<std::uint64_t>(tiles));
}

std::uint64_t versionOf(const MapReader& reader) {
  const auto value = reader.value("version");
  return value ? std::stoull(*value) : 0;
}

class FaultTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = stressFolder("faults");
    options_.vfs = FaultVfs::kName;
    options_.wal_checkpoint_bytes = 60000;  // so that moving the log is met by faults too
    options_.wal_limit_bytes = 400000;
    FaultVfs::instance().reset();
  }
  void TearDown() override {
    FaultVfs::instance().reset();
    std::filesystem::remove_all(folder_);
  }
  [[nodiscard]] std::filesystem::path path() const { return folder_ / "map.overfly"; }

  std::filesystem::path folder_;
  StoreOptions options_;
};

// Each write, sync, truncation and deletion of a run fails once in turn. The caller gets an error it can act
// on, commits the same batch again, and everything ends as without the fault.
class EachOperation : public FaultTest, public testing::WithParamInterface<Fault> {};

TEST_P(EachOperation, FailsOnceAndNothingCommittedIsLost) {
  constexpr std::uint64_t kVersions = 12;
  FaultVfs& faults = FaultVfs::instance();
  std::uint64_t total = UINT64_MAX;
  const std::uint64_t stride = parameter("OVERFLY_FAULT_STRIDE", 3);
  for (std::uint64_t at = 0; at < total; at += at < 60 ? 1 : stride) {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    faults.reset();
    faults.plan(at, GetParam(), false);
    auto store = MapStore::create(path(), {}, options_);
    if (!store) {
      EXPECT_EQ(store.error().code, ErrorCode::Io) << store.error().message;
      store = MapStore::create(path(), {}, options_);
      if (!store) store = MapStore::open(path(), options_);
      ASSERT_TRUE(store) << "operation " << at << ": " << store.error().message;
    }
    int failures = 0;
    for (std::uint64_t version = 1; version <= kVersions; ++version) {
      auto done = store->commit(batchOf(version));
      if (!done) {
        ++failures;
        ASSERT_EQ(done.error().code, ErrorCode::Io) << done.error().message;
        const auto reader = store->reader();
        ASSERT_TRUE(reader) << reader.error().message;
        ASSERT_NO_FATAL_FAILURE(expectWhole(*reader, version - 1)) << "operation " << at;
        done = store->commit(batchOf(version));
      }
      ASSERT_TRUE(done) << "operation " << at << ": " << done.error().message;
      ASSERT_EQ(*done, version * 4);
    }
    EXPECT_LE(failures, 1);
    store = fail(ErrorCode::NotFound, "closed");
    total = faults.operations();
    faults.heal();
    const auto reader = MapReader::open(path());
    ASSERT_TRUE(reader) << "operation " << at << ": " << reader.error().message;
    ASSERT_NO_FATAL_FAILURE(expectWhole(*reader, kVersions)) << "operation " << at;
  }
  EXPECT_GT(total, 100u);
}

INSTANTIATE_TEST_SUITE_P(Faults, EachOperation,
                         testing::Values(Fault::DiskFull, Fault::Error, Fault::ShortWrite),
                         [](const auto& fault) {
                           return std::string(
                               std::array{"None", "DiskFull", "IoError",
                                          "ShortWrite"}[static_cast<std::size_t>(fault.param)]);
                         });

// The power is cut at any operation; of what was not synced any sectors are on the disk. What was
// acknowledged is there, and nothing is torn.
TEST_F(FaultTest, APowerCutLosesNothingAcknowledged) {
  FaultVfs& faults = FaultVfs::instance();
  std::mt19937 random(static_cast<unsigned>(parameter("OVERFLY_SEED", 4711)));
  const std::uint64_t cuts = parameter("OVERFLY_POWER_CUTS", 200);
  for (std::uint64_t cut = 0; cut < cuts; ++cut) {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    faults.reset();
    std::uint64_t acknowledged = 0;
    {
      auto store = MapStore::create(path(), {}, options_);
      ASSERT_TRUE(store) << store.error().message;
      faults.planPowerCut(faults.operations() + random() % 400);
      for (std::uint64_t version = 1; version <= 20; ++version) {
        if (!store->commit(batchOf(version))) break;
        acknowledged = version;
      }
      faults.planPowerCut(0);  // closing writes nothing more
    }
    faults.powerCut(random);
    faults.heal();
    std::filesystem::remove(path().string() + "-shm");  // memory, gone with the power
    const auto store = MapStore::open(path(), options_);
    ASSERT_TRUE(store) << "cut " << cut << ": " << store.error().message;
    const auto reader = store->reader();
    const std::uint64_t version = versionOf(*reader);
    ASSERT_GE(version, acknowledged) << "cut " << cut;
    ASSERT_LE(version, acknowledged + 1) << "cut " << cut;
    ASSERT_NO_FATAL_FAILURE(expectWhole(*reader, version)) << "cut " << cut;
  }
}

TEST_F(FaultTest, AFullDiskDegradesTheWriterAndItRecovers) {
  FaultVfs& faults = FaultVfs::instance();
  auto store = MapStore::create(path(), {}, options_);
  ASSERT_TRUE(store) << store.error().message;
  const auto reader = store->reader();
  StoreWriter::Options options;
  options.queue_bytes = 100000;
  options.first_retry = options.last_retry = std::chrono::milliseconds(5);
  StoreWriter writer(std::move(*store), options);
  ASSERT_TRUE(writer.submit(batchOf(1))->get());

  faults.plan(0, Fault::DiskFull, true);
  auto waiting = writer.submit(batchOf(2));
  ASSERT_TRUE(waiting);
  for (int i = 0; i < 1000 && !writer.status().degraded; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_TRUE(writer.status().degraded);
  EXPECT_NE(writer.status().reason.find("full"), std::string::npos) << writer.status().reason;
  expectWhole(*reader, 1);  // serving goes on
  ASSERT_TRUE(MapReader::open(path(), options_)) << "and so do new readers";
  std::uint64_t version = 3;
  for (;; ++version) {  // bounded: the queue fills and then refuses
    const auto more = writer.submit(batchOf(version));
    if (!more) {
      EXPECT_EQ(more.error().code, ErrorCode::Unavailable);
      break;
    }
    ASSERT_LT(version, 100u);
  }
  EXPECT_FALSE(writer.flush(std::chrono::milliseconds(20)));

  faults.heal();
  EXPECT_TRUE(waiting->get());
  EXPECT_TRUE(writer.flush(std::chrono::seconds(10)));
  const StoreWriter::Status status = writer.status();
  EXPECT_FALSE(status.degraded);
  EXPECT_GT(status.failed_commits, 0u);
  EXPECT_EQ(status.waiting_bytes, 0u);
  expectWhole(*reader, version - 1);
  ASSERT_TRUE(writer.submit(batchOf(version))->get());
  expectWhole(*reader, version);
}

TEST_F(FaultTest, ClosingADegradedWriterEndsAndSaysWhatWasNotWritten) {
  auto store = MapStore::create(path(), {}, options_);
  std::future<Result<std::uint64_t>> lost;
  {
    StoreWriter writer(std::move(*store), {});
    FaultVfs::instance().plan(0, Fault::Error, true);
    lost = std::move(*writer.submit(batchOf(1)));
  }
  EXPECT_EQ(lost.get().error().code, ErrorCode::Io);
}

}  // namespace
}  // namespace overfly::tiling
