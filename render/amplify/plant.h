#pragma once
#include <cstdint>

namespace overfly::amplify {

// What a seed may become; the code of the land-cover map. 0 is bare ground (paper, 4.1: three species on two
// bits).
enum class Species : std::uint32_t { None = 0, Broadleaf = 1, Conifer = 2, Shrub = 3 };

// One plant, in the East-North-Up frame of the scene, metres. The layout is that of the GPU's buffers.
struct Plant {
  float east = 0;
  float north = 0;
  float up = 0;      // of the foot, on the ground
  float height = 0;  // top above the foot
  float radius = 0;  // of the crown
  float turn = 0;    // about the vertical, radians
  std::uint32_t species = 0;
  std::uint32_t seed = 0;  // everything else that varies comes from it

  friend bool operator==(const Plant&, const Plant&) = default;
};
static_assert(sizeof(Plant) == 32);

}  // namespace overfly::amplify
