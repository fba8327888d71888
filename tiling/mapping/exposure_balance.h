#pragma once
#include <cstdint>
#include <map>
#include <vector>

#include "tiling/mapping/thumbnail.h"

namespace overfly::tiling {

// Exposure gains that make overlapping frames equally bright. A gain belongs to a frame, not to a tile, so
// that tiles cannot differ by it. Single thread.
class ExposureBalance {
 public:
  // Compares the frame with those already there that see the same ground.
  void add(Thumbnail thumbnail, double ground_height_m);
  void remove(std::uint64_t frame_id);

  // Gain per frame: least squares over the logarithms of all overlaps' median brightness ratios, weighted by
  // overlap, held near 1 by a weak prior. A function of the set of frames.
  [[nodiscard]] std::map<std::uint64_t, float> solve() const;

 private:
  struct Ratio {
    std::uint64_t a, b;
    double log_ratio;  // of b to a
    double weight;     // share of the thumbnail that overlaps
  };
  std::map<std::uint64_t, Thumbnail> thumbnails_;
  std::vector<Ratio> ratios_;
};

}  // namespace overfly::tiling
