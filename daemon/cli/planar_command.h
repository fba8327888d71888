#pragma once
#include <optional>
#include <string>

#include "capture/geo/tile_lattice.h"
#include "config/error.h"

namespace overfly::cli {

struct PlanarCommand {
  std::string flight, map;
  geo::TileLattice lattice = geo::TileLattice::webMercator();
  std::optional<double> ground_m, gsd_m;
  int tile_size = 256;
  int cache_mb = 256;  // decoded frames and tiles in memory
  bool json = false;
};

// `overfly map --planar`: lays a flight's frames onto level ground, without a GPU. Returns an exit status.
[[nodiscard]] Result<int> mapOntoPlane(const PlanarCommand& command);

}  // namespace overfly::cli
