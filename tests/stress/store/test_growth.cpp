#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <random>
#include <thread>

#include "tests/stress/store/parameters.h"
#include "tiling/store/store_writer.h"
#include "tiling/store/tile_codec.h"

#ifdef __SANITIZE_ADDRESS__
// Freed memory that the sanitizer keeps would count as the map's.
extern "C" const char* __asan_default_options() {  // NOLINT(*-reserved-identifier): the sanitizer's name
  return "quarantine_size_mb=1:thread_local_quarantine_size_kb=64";
}
#endif

namespace overfly::tiling {
namespace {

EncodedLayer noise(std::mt19937& random, Layer layer, std::size_t bytes) {
  EncodedLayer encoded{layer, Codec::Planes, std::vector<std::uint8_t>(bytes), {}};
  for (std::uint8_t& byte : encoded.bytes) byte = static_cast<std::uint8_t>(random());
  return encoded;
}

// A client pulls a map slowly, page by page and tile by tile, while tiles keep changing: the log stays
// bounded, because no read outlives its call. 10 minutes: OVERFLY_PULL_SECONDS=600.
TEST(Growth, TheLogStaysBoundedDuringASlowPull) {
  const auto folder = stressFolder("pull");
  StoreOptions options;
  options.wal_checkpoint_bytes = 1u << 20;
  options.wal_limit_bytes = 8u << 20;
  auto store = MapStore::create(folder / "map.overfly", {}, options);
  ASSERT_TRUE(store) << store.error().message;
  std::atomic<bool> stop = false;
  std::vector<std::jthread> clients;
  for (int i = 0; i < 3; ++i)
    clients.emplace_back([&stop, reader = store->reader()] {
      ChangeCursor cursor;
      while (!stop) {
        const auto page = reader->changes(cursor, {}, 4);
        ASSERT_TRUE(page) << page.error().message;
        for (const Change& change : page->changes) {
          const auto stored = reader->read(change.key, change.layer);
          ASSERT_TRUE(stored || stored.error().code == ErrorCode::NotFound) << stored.error().message;
          std::this_thread::sleep_for(std::chrono::milliseconds(2));  // the radio
        }
        cursor = page->next.done ? ChangeCursor::after(page->next.until) : page->next;
      }
    });
  std::mt19937 random(5);
  std::uint64_t largest = 0, written = 0;
  const auto end =
      std::chrono::steady_clock::now() + std::chrono::seconds(parameter("OVERFLY_PULL_SECONDS", 5));
  while (std::chrono::steady_clock::now() < end) {
    Batch batch;
    for (int i = 0; i < 8; ++i) {
      TileWrite write;
      write.key = {20, static_cast<std::int64_t>(random() % 40), static_cast<std::int64_t>(random() % 40)};
      write.layers = {noise(random, Layer::Color, 15000), noise(random, Layer::Elevation, 8000)};
      written += 23000;
      batch.tiles.push_back(std::move(write));
    }
    ASSERT_TRUE(store->commit(batch));
    largest = std::max<std::uint64_t>(largest, std::filesystem::file_size(folder / "map.overfly-wal"));
  }
  stop = true;
  clients.clear();
  std::printf("%.0f MB written, log at most %.1f MB\n", static_cast<double>(written) * 1e-6,
              static_cast<double>(largest) * 1e-6);
  EXPECT_GT(written, 4 * options.wal_limit_bytes) << "too slow to show anything";
  // The limit, one batch beyond it, and one more while a reader finishes its step.
  EXPECT_LT(largest, options.wal_limit_bytes + (2u << 20));
  std::filesystem::remove_all(folder);
}

// Peak memory of a process of its own that writes and reads back a planar map of that many tiles.
long peakKilobytes(const std::filesystem::path& path, int tiles) {
  const pid_t child = fork();
  if (child == 0) {
    StoreOptions options;
    options.cache_bytes = 1u << 20;  // full in both runs
    auto store = MapStore::create(path, {}, options);
    if (!store) _exit(1);
    const auto reader = store->reader();
    StoreWriter writer(std::move(*store), {});
    Tile tile = Tile::blank({20, 0, 0}, 256);
    for (std::size_t i = 0; i < tile.texels(); ++i) {
      tile.elevation[i] = 100;
      tile.kind[i] = kMeasured;
      for (std::size_t c = 0; c < 4; ++c)
        tile.color[4 * i + c] = c == 3 ? 255 : static_cast<std::uint8_t>(i * 7 + c);
    }
    TileWrite write = encodeTile(tile, {}).value();
    for (int done = 0; done < tiles;) {
      Batch batch;
      for (int i = 0; i < 20 && done < tiles; ++i, ++done) {
        write.key = {20, done % 250, done / 250};
        write.layers[0].bytes.back() = static_cast<std::uint8_t>(done);  // no two alike
        batch.tiles.push_back(write);
      }
      batch.frames.resize(1);
      batch.frames[0].id = static_cast<std::uint64_t>(done);
      if (!writer.submit(std::move(batch))->get()) _exit(2);
      if (!reader->read({20, done % 250, 0}, Layer::Elevation) && done > 250) _exit(3);
    }
    ChangeCursor cursor;
    while (!cursor.done) cursor = reader->changes(cursor, {}, 100)->next;
    _exit(0);
  }
  int status = 0;
  rusage usage{};
  if (wait4(child, &status, 0, &usage) != child || !WIFEXITED(status) || WEXITSTATUS(status) != 0) return -1;
  return usage.ru_maxrss;
}

TEST(Growth, MemoryDoesNotGrowWithTheMap) {
  const auto folder = stressFolder("memory");
  const int many = static_cast<int>(parameter("OVERFLY_TILES", 20000));
  const long small = peakKilobytes(folder / "small.overfly", 1000);
  const long large = peakKilobytes(folder / "large.overfly", many);
  ASSERT_GT(small, 0);
  ASSERT_GT(large, 0);
  std::printf("peak RSS: %ld kB with 1,000 tiles, %ld kB with %d\n", small, large, many);
  EXPECT_LT(static_cast<double>(large), 1.05 * static_cast<double>(small));
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace overfly::tiling
