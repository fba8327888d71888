#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <random>
#include <thread>

#include "tests/stress/store/parameters.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling {
namespace {

constexpr int kTiles = 6;

// What tile x holds after batch `version`: both layers derive from these two numbers.
std::vector<std::uint8_t> content(int x, std::uint64_t version, Layer layer) {
  std::mt19937 random(static_cast<unsigned>(version * 100 + static_cast<std::uint64_t>(x) * 10 +
                                            static_cast<std::uint64_t>(layer)));
  std::vector<std::uint8_t> bytes(500 + random() % 20000);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

Batch batchOf(std::uint64_t version) {
  Batch batch;
  for (int x = 0; x < kTiles; ++x) {
    TileWrite write;
    write.key = {20, x, 0};
    for (const Layer layer : {Layer::Color, Layer::Elevation})
      write.layers.push_back({layer, Codec::Planes, content(x, version, layer), {}});
    batch.tiles.push_back(std::move(write));
  }
  FrameRecord frame;
  frame.id = version;
  batch.frames.push_back(frame);
  batch.enqueue = {{{20, 0, 0}, 1, static_cast<double>(version), ""}};
  batch.values = {{"version", std::to_string(version)}};
  return batch;
}

// The child: goes on writing where the map ended, and tells each acknowledged version through the pipe.
[[noreturn]] void writeForEver(const std::filesystem::path& path, int pipe_end) {
  StoreOptions options;
  options.wal_checkpoint_bytes = 1u << 20;  // so that the kill often meets the moving of the log
  auto store =
      std::filesystem::exists(path) ? MapStore::open(path, options) : MapStore::create(path, {}, options);
  if (!store) _exit(3);
  std::uint64_t version = 0;
  if (const auto last = store->reader()->value("version")) version = std::stoull(*last);
  for (;;) {
    if (!store->commit(batchOf(++version))) _exit(4);
    if (write(pipe_end, &version, sizeof version) != sizeof version) _exit(5);
  }
}

// Killed at random moments, again and again on the same map: it opens in less than a second, no tile is
// torn, no acknowledged batch is lost, and none is there in part.
TEST(Crash, KilledWritersLoseNothingAcknowledged) {
  const std::uint64_t kills = parameter("OVERFLY_KILLS", 100);
  const auto seed = static_cast<unsigned>(parameter("OVERFLY_SEED", 99));
  // On the disk, not in memory: the moments are those of real files.
  const auto folder = std::filesystem::temp_directory_path() / ("overfly-crash." + std::to_string(getpid()));
  std::filesystem::create_directories(folder);
  const auto path = folder / "map.overfly";
  std::mt19937 random(seed);
  std::uint64_t acknowledged = 0, beyond = 0;
  double slowest_s = 0;
  for (std::uint64_t kill_number = 0; kill_number < kills; ++kill_number) {
    SCOPED_TRACE("seed " + std::to_string(seed) + " kill " + std::to_string(kill_number));
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      close(ends[0]);
      writeForEver(path, ends[1]);
    }
    close(ends[1]);
    // Mostly amid commits, sometimes during opening or creation.
    std::this_thread::sleep_for(std::chrono::microseconds(random() % (kill_number % 4 == 0 ? 8000 : 90000)));
    kill(child, SIGKILL);
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status)) << "the writer ended by itself: " << WEXITSTATUS(status);
    std::uint64_t version = 0;
    while (read(ends[0], &version, sizeof version) == sizeof version) acknowledged = version;
    close(ends[0]);

    const auto begin = std::chrono::steady_clock::now();
    auto store = MapStore::open(path);
    slowest_s =
        std::max(slowest_s, std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
    if (!store) {
      ASSERT_EQ(store.error().code, ErrorCode::NotFound) << store.error().message;
      ASSERT_EQ(acknowledged, 0u) << "killed before the map was made, but there was one";
      continue;
    }
    const auto reader = store->reader();
    ASSERT_TRUE(reader) << reader.error().message;
    const auto last = reader->value("version");
    const std::uint64_t stored = last ? std::stoull(*last) : 0;
    ASSERT_GE(stored, acknowledged);
    ASSERT_LE(stored, acknowledged + 1) << "at most the batch that was being written";
    beyond += stored > acknowledged ? 1 : 0;
    acknowledged = stored;
    ASSERT_EQ(reader->revision().value(), stored * kTiles);
    ASSERT_EQ(reader->frames()->size(), stored);
    if (stored == 0) continue;
    for (int x = 0; x < kTiles; ++x) {
      const auto whole = reader->readWhole({20, x, 0}, kAllLayers);
      ASSERT_TRUE(whole) << whole.error().message;
      ASSERT_EQ(whole->layers.size(), 2u);
      for (const StoredLayer& layer : whole->layers)
        ASSERT_EQ(layer.encoded.bytes, content(x, stored, layer.encoded.layer));
    }
    ASSERT_EQ(reader->queue()->at(0).priority, static_cast<double>(stored));
  }
  std::printf("%llu kills, %llu batches, %llu of them unacknowledged; slowest opening %.3f s\n",
              static_cast<unsigned long long>(kills), static_cast<unsigned long long>(acknowledged),
              static_cast<unsigned long long>(beyond), slowest_s);
  EXPECT_GT(acknowledged, kills / 4) << "the writers did not get to write";
  EXPECT_LT(slowest_s, 1.0);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace overfly::tiling
