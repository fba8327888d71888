// One orthophoto (8192 x 8192, RGB GeoTIFF on the Web Mercator lattice) cut into tiles with all coarser
// levels onto the same disk: by this project's codec, pyramid and store, and by gdal2tiles.py with as many
// processes as there are processors. Tiles of all levels are counted, and named by what they hold: gdal2tiles
// of this GDAL writes PNG or WebP, the store JPEG (and WebP where a tile has a hole).
#include <benchmark/benchmark.h>
#include <cpl_conv.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>
#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/bench/clipmap/ground.h"
#include "tiling/clipmap/parent.h"
#include "tiling/store/store_writer.h"
#include "tiling/store/tile_codec.h"

namespace overfly::tiling {
namespace {

constexpr int kSide = 8192, kTile = 256, kZoom = 21, kLevels = 6;  // 32 x 32 tiles down to one
constexpr std::int64_t kX = 1091040, kY = 731936;                  // of the first tile, multiples of 32

std::filesystem::path scratch(const std::string& name) {
  return std::filesystem::temp_directory_path() / ("overfly-" + name + "." + std::to_string(getpid()));
}

// Made once, removed at the end of the program.
const std::filesystem::path& orthophoto() {
  struct File {
    std::filesystem::path path = scratch("orthophoto").string() + ".tif";
    File() {
      GDALAllRegister();
      const std::vector<std::uint8_t> rgb = paintGround(kSide, kSide, 4);
      auto* driver = GetGDALDriverManager()->GetDriverByName("GTiff");
      char** options = CSLSetNameValue(nullptr, "TILED", "YES");
      std::unique_ptr<GDALDataset> file(driver->Create(path.c_str(), kSide, kSide, 3, GDT_Byte, options));
      CSLDestroy(options);
      const double cell = geo::TileLattice::kCellMetres / (1 << kZoom), texel = cell / kTile;
      const double half = geo::TileLattice::kCellMetres / 2;
      double transform[6] = {static_cast<double>(kX) * cell - half, texel, 0,
                             half - static_cast<double>(kY) * cell, 0,     -texel};
      file->SetGeoTransform(transform);
      OGRSpatialReference reference;
      reference.importFromEPSG(3857);
      file->SetSpatialRef(&reference);
      auto* pixels = const_cast<std::uint8_t*>(rgb.data());
      if (file->RasterIO(GF_Write, 0, 0, kSide, kSide, pixels, kSide, kSide, GDT_Byte, 3, nullptr, 3,
                         3 * kSide, 1, nullptr) != CE_None)
        path.clear();
    }
    ~File() { std::filesystem::remove(path); }
  };
  static const File file;
  return file.path;
}

std::size_t bytesBelow(const std::filesystem::path& folder, std::size_t& files) {
  std::size_t bytes = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    if (entry.is_regular_file() &&
        (entry.path().extension() == ".png" || entry.path().extension() == ".webp")) {
      bytes += entry.file_size();
      ++files;
    }
  return bytes;
}

double cpuOf(int who) {
  rusage usage{};
  getrusage(who, &usage);
  return static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

void report(benchmark::State& state, std::size_t tiles, std::size_t bytes, double cpu_s) {
  state.counters["tiles"] = static_cast<double>(tiles) / static_cast<double>(state.iterations());
  state.counters["tiles/s"] = benchmark::Counter(static_cast<double>(tiles), benchmark::Counter::kIsRate);
  state.counters["kB/tile"] = 1e-3 * static_cast<double>(bytes) / static_cast<double>(tiles);
  state.counters["cpu_ms/tile"] = 1000 * cpu_s / static_cast<double>(tiles);
}

void gdal2tiles(benchmark::State& state, const char* driver) {
  if (std::system("command -v gdal2tiles.py >/dev/null") != 0)
    return state.SkipWithError("gdal2tiles.py is not installed (Debian: python3-gdal)");
  const std::string image = orthophoto().string();
  const auto folder = scratch("gdal2tiles");
  std::size_t tiles = 0, bytes = 0;
  const double before = cpuOf(RUSAGE_CHILDREN);
  for (auto _ : state) {
    state.PauseTiming();
    std::filesystem::remove_all(folder);
    state.ResumeTiming();
    const std::string command = "gdal2tiles.py -q --xyz -w none -r average -z " +
                                std::to_string(kZoom - kLevels + 1) + "-" + std::to_string(kZoom) +
                                " --processes=" + std::to_string(std::thread::hardware_concurrency()) +
                                " --tiledriver=" + driver + " " + image + " " + folder.string() +
                                " >/dev/null 2>&1 && sync -f " + folder.string();
    if (std::system(command.c_str()) != 0) return state.SkipWithError("gdal2tiles.py failed");
    state.PauseTiming();
    bytes += bytesBelow(folder, tiles);
    std::filesystem::remove_all(folder);
    state.ResumeTiming();
  }
  report(state, tiles, bytes, cpuOf(RUSAGE_CHILDREN) - before);
}

// Two threads: one cuts, makes parents and codes every other row of 32 tiles.
Result<void> pyramid(MapStore store, const std::string& image, std::size_t& tiles, std::size_t& bytes) {
  StoreWriter writer(std::move(store), {});
  std::map<geo::TileKey, Tile> level;
  Result<void> result;
  std::mutex mutex;
  const auto code = [&](Tile&& tile, Batch& batch) {
    auto write = encodeTile(tile, {});
    const std::scoped_lock lock(mutex);
    if (!write) {
      result = tl::unexpected(write.error());
      return;
    }
    for (const EncodedLayer& layer : write->layers) bytes += layer.bytes.size();
    ++tiles;
    batch.tiles.push_back(std::move(*write));
    const geo::TileKey key = tile.key;
    level.insert_or_assign(key, std::move(tile));
  };
  const auto inBoth = [&](int rows, auto row) {
    const auto work = [&](int first) {
      for (int y = first; y < rows; y += 2) {
        Batch batch;
        row(y, batch);
        while (!writer.submit(std::move(batch))) (void)writer.flush(std::chrono::seconds(10));
      }
    };
    std::jthread other(work, 1);
    work(0);
  };
  inBoth(kSide / kTile, [&](int y, Batch& batch) {
    std::unique_ptr<GDALDataset> file(GDALDataset::Open(image.c_str(), GDAL_OF_RASTER));
    for (int x = 0; x < kSide / kTile; ++x) {
      Tile tile;
      tile.key = {kZoom, kX + x, kY + y};
      tile.size = kTile;
      tile.color.assign(4 * tile.texels(), 255);
      if (file->RasterIO(GF_Read, x * kTile, y * kTile, kTile, kTile, tile.color.data(), kTile, kTile,
                         GDT_Byte, 3, nullptr, 4, 4 * kTile, 1, nullptr) != CE_None)
        result = fail(ErrorCode::Io, "the orthophoto does not read");
      code(std::move(tile), batch);
    }
  });
  for (int l = 1; l < kLevels; ++l) {
    const std::map<geo::TileKey, Tile> children = std::exchange(level, {});
    const int side = (kSide / kTile) >> l;
    inBoth(side, [&](int y, Batch& batch) {
      for (int x = 0; x < side; ++x) {
        const geo::TileKey key{kZoom - l, (kX >> l) + x, (kY >> l) + y};
        std::array<const Tile*, 4> held{};
        for (int i = 0; i < 4; ++i) held[static_cast<std::size_t>(i)] = &children.at(geo::childOf(key, i));
        code(makeParent(key, held), batch);
      }
    });
  }
  if (!writer.flush(std::chrono::seconds(60))) return fail(ErrorCode::Io, "the disk does not take the map");
  return result;
}

void overfly(benchmark::State& state) {
  const std::string image = orthophoto().string();
  const auto folder = scratch("pyramid");
  std::size_t tiles = 0, bytes = 0;
  const double before = cpuOf(RUSAGE_SELF);
  for (auto _ : state) {
    state.PauseTiming();
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
    MapMeta meta;
    meta.base_zoom = kZoom;
    auto store = MapStore::create(folder / "map.overfly", meta);
    state.ResumeTiming();
    if (auto ok = pyramid(std::move(*store), image, tiles, bytes); !ok)
      return state.SkipWithError(ok.error().message.c_str());
    state.PauseTiming();
    std::filesystem::remove_all(folder);
    state.ResumeTiming();
  }
  report(state, tiles, bytes, cpuOf(RUSAGE_SELF) - before);
}
BENCHMARK(overfly)->Name("pyramid/overfly_jpeg")->Unit(benchmark::kMillisecond)->Iterations(1)->UseRealTime();
BENCHMARK_CAPTURE(gdal2tiles, png, "PNG")
    ->Name("pyramid/gdal2tiles_png")
    ->Unit(benchmark::kMillisecond)
    ->Iterations(1)
    ->UseRealTime();
BENCHMARK_CAPTURE(gdal2tiles, webp, "WEBP")
    ->Name("pyramid/gdal2tiles_webp")
    ->Unit(benchmark::kMillisecond)
    ->Iterations(1)
    ->UseRealTime();

}  // namespace
}  // namespace overfly::tiling
