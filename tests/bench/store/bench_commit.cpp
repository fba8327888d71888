// Tiles per second onto the disk, with their parents, and what the disk has to write for them. On the disk
// of the temporary folder (TMPDIR). Counters: amplification is bytes that the kernel was given for the disk
// (/proc/self/io, write_bytes) over bytes of coded layers; syncs are all calls of fsync and fdatasync.
#include <benchmark/benchmark.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/bench/store/samples.h"
#include "tiling/store/store_writer.h"
#include "tiling/store/tile_codec.h"

namespace overfly::tiling {
namespace {

std::uint64_t writtenBytes() {
  std::ifstream file("/proc/self/io");
  for (std::string key; file >> key;) {
    std::uint64_t value = 0;
    file >> value;
    if (key == "write_bytes:") return value;
  }
  return 0;
}

std::atomic<std::uint64_t> syncs = 0;

}  // namespace
}  // namespace overfly::tiling

// Stand in front of the C library's for SQLite too.
extern "C" int fdatasync(int descriptor) {
  ++overfly::tiling::syncs;
  return static_cast<int>(syscall(SYS_fdatasync, descriptor));
}
extern "C" int fsync(int descriptor) {
  ++overfly::tiling::syncs;
  return static_cast<int>(syscall(SYS_fsync, descriptor));
}

namespace overfly::tiling {
namespace {

// `group` tiles of level 0 a batch; every fourth brings a parent, as a growing map does. `rewrites`: each
// tile is written that often, as overlapping frames do.
void commits(benchmark::State& state) {
  const auto group = static_cast<int>(state.range(0));
  const auto rewrites = static_cast<int>(state.range(1));
  constexpr int kTiles = 1024;
  std::vector<TileWrite> coded;
  for (std::size_t i = 0; i < 64; ++i) coded.push_back(encodeTile(tileOver(i), {}).value());
  std::uint64_t disk = 0, layer_bytes = 0, level0 = 0, parents = 0;
  syncs = 0;
  for (auto _ : state) {
    state.PauseTiming();
    const auto folder =
        std::filesystem::temp_directory_path() / ("overfly-bench." + std::to_string(getpid()));
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
    auto store = MapStore::create(folder / "map.overfly", {});
    const std::uint64_t before = writtenBytes();
    state.ResumeTiming();
    for (int pass = 0; pass < rewrites; ++pass)
      for (int i = 0; i < kTiles;) {
        Batch batch;
        for (int n = 0; n < group && i < kTiles; ++n, ++i) {
          TileWrite write = coded[static_cast<std::size_t>(i * 7 + pass * 5) % coded.size()];
          write.key = {20, i % 32, i / 32};
          batch.tiles.push_back(write);
          ++level0;
          if (i % 4 == 3) {
            write.key = {19, i % 32 / 4, i / 32};
            batch.tiles.push_back(std::move(write));
            ++parents;
          }
        }
        for (const TileWrite& tile : batch.tiles)
          for (const EncodedLayer& layer : tile.layers) layer_bytes += layer.bytes.size();
        if (!store->commit(batch)) state.SkipWithError("commit failed");
      }
    (void)store->checkpoint();
    state.PauseTiming();
    disk += writtenBytes() - before;
    store = fail(ErrorCode::NotFound, "closed");
    std::filesystem::remove_all(folder);
    state.ResumeTiming();
  }
  state.counters["tiles/s"] = benchmark::Counter(static_cast<double>(level0), benchmark::Counter::kIsRate);
  state.counters["parents/s"] = benchmark::Counter(static_cast<double>(parents), benchmark::Counter::kIsRate);
  state.counters["bytes/tile"] = static_cast<double>(layer_bytes) / static_cast<double>(level0 + parents);
  state.counters["amplification"] = static_cast<double>(disk) / static_cast<double>(layer_bytes);
  state.counters["syncs/tile"] = static_cast<double>(syncs.load()) / static_cast<double>(level0);
}
BENCHMARK(commits)
    ->ArgNames({"group", "rewrites"})
    ->Args({1, 1})
    ->Args({16, 1})
    ->Args({64, 1})
    ->Args({16, 4})
    ->Unit(benchmark::kMillisecond)
    ->Iterations(2)
    ->UseRealTime();

// Encoding and committing through the writing thread: the encoder's thread and the disk work side by side.
void throughWriter(benchmark::State& state) {
  std::vector<Tile> tiles;
  for (std::size_t i = 0; i < 64; ++i) tiles.push_back(tileOver(i));
  const auto folder = std::filesystem::temp_directory_path() / ("overfly-bench." + std::to_string(getpid()));
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  {
    StoreWriter writer(std::move(*MapStore::create(folder / "map.overfly", {})), {});
    std::int64_t done = 0;
    for (auto _ : state) {
      Batch batch;
      TileWrite write = encodeTile(tiles[static_cast<std::size_t>(done) % tiles.size()], {}).value();
      write.key = {20, done % 64, done / 64};
      ++done;
      batch.tiles.push_back(std::move(write));
      auto future = writer.submit(std::move(batch));
      if (!future && !writer.flush(std::chrono::seconds(10))) state.SkipWithError("the writer stands still");
    }
    (void)writer.flush(std::chrono::seconds(60));
    const auto status = writer.status();
    state.counters["tiles/s"] = benchmark::Counter(static_cast<double>(done), benchmark::Counter::kIsRate);
    state.counters["tiles/commit"] = static_cast<double>(status.tiles) / static_cast<double>(status.commits);
  }
  std::filesystem::remove_all(folder);
}
BENCHMARK(throughWriter)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace overfly::tiling
