#pragma once
#include <array>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>

#include "capture/geo/tile_lattice.h"
#include "render/preview/tile_image.h"

namespace overfly::preview {

// Makes tiles' images on a thread of its own, in the order asked for, so that the thread that draws has only
// to upload them. Thread-safe.
class ImageMaker {
 public:
  struct Job {
    geo::TileKey key;
    int level = 0, x = 0, y = 0;                 // of the domain
    TileBlock block;                             // of a tile ...
    std::array<SourceTilePtr, 4> children;       // ... or of the top
    std::array<std::uint64_t, 9> generations{};  // of the block (of the children: the first four)
    bool top = false;
    int size = 0;  // texels across
    double base_height_m = 0;
    NoData no_data = NoData::Hole;
  };
  struct Made {
    Job job;
    TileImage image;
    TopImage top;
  };
  // Images that wait or are made at a time, so that what is uploaded is not old.
  static constexpr std::size_t kMost = 8;

  ImageMaker() = default;  // the thread ends with the image it makes when this is destroyed
  ImageMaker(const ImageMaker&) = delete;
  ImageMaker& operator=(const ImageMaker&) = delete;

  // False: there are kMost already. The thread begins with the first job.
  bool add(Job job);
  // True while the tile's image waits, is made, or is not taken yet.
  [[nodiscard]] bool has(const geo::TileKey& key, bool top) const;
  // The oldest one that is made.
  [[nodiscard]] std::optional<Made> take();

 private:
  void serve(const std::stop_token& stop);

  mutable std::mutex mutex_;
  std::condition_variable_any wake_;
  std::deque<Job> jobs_;  // the front is being made
  std::deque<Made> made_;
  std::jthread thread_;  // last: uses everything above
};

}  // namespace overfly::preview
