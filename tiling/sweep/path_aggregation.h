#pragma once
#include <cstddef>
#include <vector>

namespace overfly::tiling {

// Scores of every texel and plane (higher is better), and their semi-global aggregation: along eight
// directions the best path's score with a penalty for each change of plane (Hirschmueller 2008, eq. 13, with
// scores instead of costs). Single-threaded, deterministic.
class PlaneVolume {
 public:
  PlaneVolume(int side, int planes)
      : side_(side),
        planes_(planes),
        score_(static_cast<std::size_t>(side) * static_cast<std::size_t>(side) *
                   static_cast<std::size_t>(planes),
               0.0f) {}

  [[nodiscard]] float& at(std::size_t texel, int plane) {
    return score_[texel * static_cast<std::size_t>(planes_) + static_cast<std::size_t>(plane)];
  }

  struct Choice {
    float plane;  // with the fraction from a parabola through the aggregated scores
    float score;  // the texel's own score there, not the aggregate
    float drop;   // of the own score to the better of the two neighbouring planes
  };
  // Penalties in score units: one plane up or down, and any larger change.
  [[nodiscard]] std::vector<Choice> aggregate(float step_penalty, float jump_penalty) const;

 private:
  int side_;
  int planes_;
  std::vector<float> score_;
};

}  // namespace overfly::tiling
