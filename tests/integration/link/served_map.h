#pragma once
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>

#include "daemon/link/link_server.h"
#include "tests/integration/link/client.h"
#include "tests/integration/link/made_map.h"

namespace overfly::test {

// A made-up map of 4 x 4 tiles at zoom 18 behind a real server on loopback.
class ServedMap : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = std::filesystem::temp_directory_path() / "overfly-link-XXXXXX";
    folder_ = mkdtemp(pattern.data());
    map_ = std::make_unique<MadeMap>(folder_ / "made.overfly", geo::TileKey{18, 137000, 87000}, 4);
    options_.port = 0;
  }
  void TearDown() override {
    server_.reset();
    map_.reset();
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  void serve() {
    server_ = std::make_unique<link::LinkServer>(
        options_, link::showMaps({{"made", "Made-up map", folder_ / "made.overfly", 0, false, true}}));
    const auto started = server_->start();
    ASSERT_TRUE(started) << started.error().message;
    base_ = "http://127.0.0.1:" + std::to_string(server_->port());
  }
  [[nodiscard]] static std::string tilePath(const std::string& layer, const geo::TileKey& key,
                                            const std::string& extension) {
    return "/tiles/" + layer + "/" + std::to_string(key.zoom) + "/" + std::to_string(key.x) + "/" +
           std::to_string(key.y) + "." + extension;
  }
  [[nodiscard]] geo::TileKey cell(int x, int y) const {
    return {18, map_->corner().x + x, map_->corner().y + y};
  }

  std::filesystem::path folder_;
  std::unique_ptr<MadeMap> map_;
  link::LinkOptions options_;
  std::unique_ptr<link::LinkServer> server_;
  std::string base_;
};

}  // namespace overfly::test
