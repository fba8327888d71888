#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "capture/record/flight.h"
#include "tiling/mapping/mapper.h"

namespace overfly::tiling {

struct BatchOptions {
  MapperOptions mapper;
  geo::TileLattice lattice = geo::TileLattice::webMercator();
  int reduce = 1;  // frames are taken at so many times fewer columns and rows (1, 2, 4, 8): for a quick look
  GroundOptions ground;  // its tile_size is the mapper's; a height that is not given is what the flight says
                         // where the images do not tell
};

struct BatchResult {
  MapGround ground;
  int cell_zoom = 0;
  std::uint64_t frames_used = 0;
  std::vector<std::string> refused;  // "NAME: reason" of every frame that was not used
  MapperStatistics statistics;
  double wall_s = 0;
};

// What happens while a flight is mapped. All called on the calling thread.
struct BatchEvents {
  std::function<Result<void>(const MapGround&)> ground;  // settled: the place for a map to be created
  // A frame that is in use; id is its index in the flight.
  std::function<Result<void>(std::uint64_t id, const capture::FlightFrame&, const IndexedFrame&)> frame;
  std::function<Result<void>(Tile&&)> tile;  // a level-0 tile is done
  std::function<void(const std::string& stage, std::uint64_t done, std::uint64_t total)> progress;
};

// Maps a whole flight as fast as it can: the same Mapper as in flight, all frames first. Thread-bound to the
// context's thread.
[[nodiscard]] Result<BatchResult> mapFlight(gl::Context& context, const capture::Flight& flight,
                                            const BatchOptions& options, const BatchEvents& events);

// mapFlight() with its level-0 tiles kept in memory.
struct MappedTiles {
  BatchResult result;
  std::map<geo::TileKey, Tile> tiles;
};
[[nodiscard]] Result<MappedTiles> mapFlightToTiles(
    gl::Context& context, const capture::Flight& flight, const BatchOptions& options,
    const std::function<void(const std::string& stage, std::uint64_t done, std::uint64_t total)>& progress =
        {});

}  // namespace overfly::tiling
