#include <gmock/gmock.h>
#include <sqlite3.h>

#include <fstream>
#include <random>

#include "tests/unit/store/store_fixture.h"

namespace overfly::tiling {
namespace {

using testing::HasSubstr;

class DamageTest : public StoreTest {
 protected:
  static std::string content(int x) {
    return std::to_string(x) + std::string(static_cast<std::size_t>(3000 + 700 * x), 'c');
  }

  void makeMap(int tiles) {
    auto store = MapStore::create(path(), {});
    ASSERT_TRUE(store) << store.error().message;
    Batch batch;
    for (int x = 0; x < tiles; ++x) batch.tiles.push_back(tile(20, x, 0, content(x)));
    ASSERT_TRUE(store->commit(batch));
  }
  void sql(const char* text) {
    sqlite3* database = nullptr;
    ASSERT_EQ(sqlite3_open(path().c_str(), &database), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(database, text, nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(database);
    sqlite3_close(database);
  }
  [[nodiscard]] std::string bytes() const {
    std::ifstream file(path(), std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void put(const std::string& bytes) const {
    std::ofstream(path(), std::ios::binary | std::ios::trunc) << bytes;
  }
};

TEST_F(DamageTest, AChangedByteIsReportedNotServed) {
  makeMap(3);
  sql("UPDATE layer SET bytes = CAST('9' || substr(bytes, 2) AS BLOB) WHERE id = 2 * 256 + 1");
  const auto reader = MapReader::open(path());
  EXPECT_EQ(reader->read({20, 1, 0}, Layer::Color).error().code, ErrorCode::Corrupt);
  EXPECT_EQ(reader->readWhole({20, 1, 0}, kAllLayers).error().code, ErrorCode::Corrupt);
  EXPECT_TRUE(reader->read({20, 1, 0}, Layer::Elevation));
  const auto damaged = reader->verify().value();
  ASSERT_EQ(damaged.size(), 1u);
  EXPECT_EQ(damaged[0], (std::pair{geo::TileKey{20, 1, 0}, Layer::Color}));
}

TEST_F(DamageTest, ADamagedTileIsWrittenAnewEvenWithTheSameBytes) {
  makeMap(3);
  sql("UPDATE layer SET checksum = checksum + 1 WHERE id = 2 * 256 + 1");
  auto store = MapStore::open(path());
  const auto reader = store->reader();
  ASSERT_EQ(reader->read({20, 1, 0}, Layer::Color).error().code, ErrorCode::Corrupt);
  Batch batch;
  batch.tiles = {tile(20, 1, 0, content(1))};
  ASSERT_TRUE(store->commit(batch));
  EXPECT_EQ(text(reader->read({20, 1, 0}, Layer::Color).value()), content(1));
}

TEST_F(DamageTest, ARowUnderTheWrongKeyIsDamage) {
  makeMap(2);
  sql("UPDATE tile SET x = 7 WHERE x = 1");
  EXPECT_EQ(MapReader::open(path())->read({20, 7, 0}, Layer::Color).error().code, ErrorCode::Corrupt);
}

TEST_F(DamageTest, ATornFileIsRefusedWithAdvice) {
  makeMap(40);
  const std::string whole = bytes();
  put(whole.substr(0, whole.size() / 2));
  const auto reader = MapReader::open(path());
  ASSERT_FALSE(reader);
  EXPECT_EQ(reader.error().code, ErrorCode::Corrupt);
  EXPECT_THAT(reader.error().message, HasSubstr("restore it from a copy"));
  EXPECT_EQ(MapStore::open(path()).error().code, ErrorCode::Corrupt);
}

TEST_F(DamageTest, AMissingTableIsRefused) {
  makeMap(1);
  sql("DROP TABLE extent");
  const auto reader = MapReader::open(path());
  EXPECT_EQ(reader.error().code, ErrorCode::Corrupt);
  EXPECT_THAT(reader.error().message, HasSubstr("extent"));
}

TEST_F(DamageTest, AForeignDatabaseAndANewerFormatAreRefused) {
  makeMap(1);
  sql("PRAGMA user_version = 99");
  EXPECT_THAT(MapReader::open(path()).error().message, HasSubstr("newer overfly"));
  sql("PRAGMA application_id = 1196437808");
  EXPECT_EQ(MapStore::open(path()).error().code, ErrorCode::BadInput);
  EXPECT_THAT(MapStore::open(path()).error().message, HasSubstr("not an overfly map"));
}

// Whatever bytes are flipped or cut: no crash, and whatever is served is what was written.
TEST_F(DamageTest, RandomDamageNeverServesWrongBytes) {
  constexpr int kTiles = 12;
  makeMap(kTiles);
  const std::string whole = bytes();
  const char* seed_text = std::getenv("OVERFLY_SEED");
  const unsigned seed = seed_text != nullptr ? static_cast<unsigned>(std::stoul(seed_text)) : 20240611;
  std::mt19937 random(seed);
  int refused = 0, corrupt = 0, served = 0;
  for (int round = 0; round < 300; ++round) {
    std::string copy = whole;
    for (std::size_t flips = 1 + random() % 20; flips > 0; --flips)
      copy[random() % copy.size()] = static_cast<char>(random());
    if (round % 7 == 0) copy.resize(random() % copy.size());
    std::filesystem::remove(path().string() + "-wal");
    std::filesystem::remove(path().string() + "-shm");
    put(copy);
    const auto reader = MapReader::open(path());
    if (!reader) {
      ++refused;
      continue;
    }
    for (int x = 0; x < kTiles; ++x) {
      const auto color = reader->read({20, x, 0}, Layer::Color);
      if (color) {
        ++served;
        ASSERT_EQ(text(*color), content(x)) << "seed " << seed << " round " << round;
      } else {
        corrupt += color.error().code == ErrorCode::Corrupt ? 1 : 0;
      }
    }
    (void)reader->changes({}, {}, 1000);
    (void)reader->statistics();
    (void)reader->verify();
  }
  EXPECT_GT(refused, 0);
  EXPECT_GT(corrupt, 0);
  EXPECT_GT(served, 0);
}

}  // namespace
}  // namespace overfly::tiling
