#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "config/error.h"
#include "tiling/sweep/detail/sweep_passes.h"

namespace overfly::tiling::detail {

// Second heights at which the views agree about as well as at the first: where the texture repeats, the sweep
// cannot tell which is right, and coarse to fine hides it, because each grid looks only around the result of
// the coarser one. A rival found on one grid is looked at again on every finer one, until it falls behind or
// the finest says so too. A pattern finer than the coarse grids' pixels shows only on the last two: there a
// few texels are tried in bands to both sides of their height, and where one of them has a rival, all around
// it. The better of the two is the height, so that a search that followed the wrong one comes back.
//
// Beside a step the window sees two surfaces, and both agree: that is a line one texel wide, and only areas
// count here.
class Rivals {
 public:
  // `max_share`: of the best agreement, from which a rival counts.
  explicit Rivals(double max_share) : max_share_(static_cast<float>(max_share)) {}

  // From the search of the whole range on the coarsest grid: per texel the best, and the best agreement that
  // is at least three planes away from it, as a share, with its height.
  void begin(int side, std::span<const Best> best, std::span<const float> rival_height,
             std::span<const float> rival_share);
  // On the next finer grid, where `best` has been found.
  [[nodiscard]] Result<void> refine(SweepPasses& passes, const Pass& pass, std::span<Best> best,
                                    std::uint64_t& samples);
  // 1 where a texel of the grid last seen has a rival.
  [[nodiscard]] std::vector<std::uint8_t> texels() const;

 private:
  [[nodiscard]] Result<void> look(SweepPasses& passes, const Pass& pass, std::span<Best> best,
                                  std::span<const float> base, std::span<const std::uint8_t> mask,
                                  std::uint64_t& samples);
  [[nodiscard]] bool isRival(std::size_t texel, std::span<const Best> best) const;
  void dropLines(int side);

  float max_share_;
  std::vector<float> height_;     // of the rival; NaN: none
  std::vector<float> agreement_;  // of the rival on this grid
};

}  // namespace overfly::tiling::detail
