#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "capture/record/flight.h"
#include "tiling/mapping/mapper.h"

namespace overfly::tiling {

// A map whose surface another camera's frames are laid over.
struct DrapeSurface {
  geo::TileLattice lattice = geo::TileLattice::webMercator();
  int base_zoom = 0;
  double anchor_px = 0.5;  // unwrapped plane x of the map's first frame
  // Heights of a level-0 tile, tile_size squared, ellipsoidal, metres, NaN for none; empty: no such tile.
  std::function<Result<std::vector<float>>(const geo::TileKey&)> heights;
};

struct DrapeResult {
  std::uint64_t frames_used = 0;
  std::vector<std::string> refused;  // "NAME: reason" of every frame that was not used
};

// Lays the frames of a flight over a surface that is there already: orthophotos of a second camera (thermal,
// near-infrared), whose pictures are too coarse or too flat for heights of their own. Occlusion, choice of
// views and exposure as for the first one's. `options`: its tile_size is the map's. `tile` gets level-0 tiles
// with colour. BadInput: no frame shows ground that has heights. Thread-bound to the context's thread.
[[nodiscard]] Result<DrapeResult> drapeFlight(
    gl::Context& context, const capture::Flight& flight, const DrapeSurface& surface,
    const MapperOptions& options, const std::function<Result<void>(Tile&&)>& tile,
    const std::function<void(const std::string& stage, std::uint64_t done, std::uint64_t total)>& progress =
        {});

}  // namespace overfly::tiling
