#pragma once
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>

#include "tiling/store/map_store.h"

namespace overfly::tiling {

// In memory where the machine has such a file system: these tests ask for hundreds of synced commits.
inline std::filesystem::path testFolder(const std::string& name) {
  const std::filesystem::path memory = "/dev/shm";
  const auto base = access(memory.c_str(), W_OK) == 0 ? memory : std::filesystem::temp_directory_path();
  const auto folder = base / ("overfly-" + name + "." + std::to_string(getpid()));
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  return folder;
}

// A folder of its own per test, removed afterwards.
class StoreTest : public testing::Test {
 protected:
  void SetUp() override {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = testFolder(std::string(info->test_suite_name()) + "." + info->name());
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  [[nodiscard]] std::filesystem::path path() const { return folder_ / "map.overfly"; }

  static EncodedLayer layer(Layer layer, std::string_view bytes, Codec codec = Codec::Planes) {
    return {layer, codec, {bytes.begin(), bytes.end()}, {1, 2, 3}};
  }
  static TileWrite tile(int zoom, std::int64_t x, std::int64_t y, std::string_view bytes) {
    TileWrite write;
    write.key = {zoom, x, y};
    write.layers = {layer(Layer::Color, bytes), layer(Layer::Elevation, std::string(bytes) + "h")};
    return write;
  }
  static std::string text(const StoredLayer& stored) {
    return {stored.encoded.bytes.begin(), stored.encoded.bytes.end()};
  }

  std::filesystem::path folder_;
};

}  // namespace overfly::tiling
