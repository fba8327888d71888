#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "tiling/store/tile_codec.h"

namespace {

using namespace overfly::tiling;
namespace fs = std::filesystem;

fs::path workFile() {
  return fs::temp_directory_path() / ("overfly_fuzz_map_" + std::to_string(getpid()) + ".overfly");
}
void removeAll(const fs::path& file) {
  std::error_code ignored;
  for (const char* suffix : {"", "-wal", "-shm", "-journal"}) fs::remove(file.string() + suffix, ignored);
}

// A small whole map, made once.
const std::vector<char>& wholeMap() {
  static const std::vector<char> bytes = [] {
    const fs::path file = workFile();
    removeAll(file);
    {
      MapMeta meta;
      meta.tile_size = 32;
      meta.base_zoom = 20;
      auto store = MapStore::create(file, meta);
      if (!store) std::abort();
      Batch batch;
      for (int i = 0; i < 3; ++i) {
        Tile tile = Tile::blank({20, i, 7}, 32);
        std::fill(tile.elevation.begin(), tile.elevation.end(), 100.0f + static_cast<float>(i));
        std::fill(tile.color.begin(), tile.color.end(), static_cast<std::uint8_t>(255));
        std::fill(tile.kind.begin(), tile.kind.end(), static_cast<std::uint8_t>(kMeasured));
        auto coded = encodeTile(tile, encodeOptions(meta));
        if (!coded) std::abort();
        batch.tiles.push_back(std::move(*coded));
      }
      if (!store->commit(batch)) std::abort();
    }
    std::ifstream in(file, std::ios::binary);
    std::vector<char> all{std::istreambuf_iterator<char>(in), {}};
    in.close();
    removeAll(file);
    return all;
  }();
  return bytes;
}

}  // namespace

// The bytes say where and how a whole map file is damaged; or, beginning with 'S', they are the file. Opened,
// listed and read: tiles, or errors; nothing else.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  std::vector<char> bytes;
  if (data[0] == 'S') {
    bytes.assign(data, data + size);
  } else {
    bytes = wholeMap();
    for (std::size_t i = 0; i + 4 < size; i += 5) {
      const std::size_t at = (static_cast<std::size_t>(data[i]) | static_cast<std::size_t>(data[i + 1]) << 8 |
                              static_cast<std::size_t>(data[i + 2]) << 16) %
                             bytes.size();
      if (data[i + 3] == 255)
        bytes.resize(std::max<std::size_t>(at, 1));
      else
        bytes[at] = static_cast<char>(data[i + 4]);
    }
  }
  const fs::path file = workFile();
  removeAll(file);
  std::ofstream(file, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  if (auto reader = MapReader::open(file)) {
    (void)reader->meta();
    if (const auto keys = reader->keys(20, Layer::Color, {}, 1000)) {
      for (const auto& key : *keys)
        if (const auto tile = readTile(*reader, key); tile && tile->size != reader->tileSize()) std::abort();
    } else if (keys.error().message.empty()) {
      std::abort();
    }
  } else if (reader.error().message.empty()) {
    std::abort();
  }
  removeAll(file);
  return 0;
}
