#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "tiling/store/map_store.h"
#include "tiling/tile.h"

// A made-up map: rolling ground with fields, known at every point, so that what comes over the link can be
// compared with what was put in.
namespace overfly::test {

class MadeMap {
 public:
  // A map of side x side level-0 tiles at `zoom`, north-west tile `corner`, and their parents down to one
  // tile.
  MadeMap(const std::filesystem::path& path, geo::TileKey corner, int side, int tile_size = 256);

  // Makes these level-0 tiles (x, y from the corner) and all their parents; returns the revision.
  std::uint64_t make(const std::vector<std::pair<int, int>>& cells, int variant = 0);
  std::uint64_t makeAll(int variant = 0);
  std::uint64_t erase(int x, int y);
  void addFrames(int count);

  [[nodiscard]] static float heightAt(double plane_x, double plane_y);
  [[nodiscard]] tiling::MapStore& store() { return store_; }
  [[nodiscard]] const geo::TileKey& corner() const { return corner_; }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] geo::Geodetic centre() const;

 private:
  tiling::TileWrite tile(const geo::TileKey& key, int variant) const;
  std::filesystem::path path_;
  tiling::MapMeta meta_;
  tiling::MapStore store_;
  geo::TileKey corner_;
  int side_;
  std::uint64_t next_frame_ = 1;
};

}  // namespace overfly::test
