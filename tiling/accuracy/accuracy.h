#pragma once
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "capture/geo/geodetic.h"
#include "capture/geo/tile_lattice.h"
#include "config/error.h"
#include "tiling/tile.h"

namespace overfly::tiling {

// A point whose height is known from elsewhere.
struct ReferencePoint {
  geo::Geodetic place;  // height in the flight's datum
  int track = 0;        // frames that see it; 0: not from images
};

// reference_points.csv (x, y, z in the ENU frame of `origin`, track_length): NotFound, or BadInput with the
// line.
[[nodiscard]] Result<std::vector<ReferencePoint>> readReferencePoints(const std::filesystem::path& file,
                                                                      const geo::Geodetic& origin);

// Height errors (map minus reference) in multiples of the GSD.
struct ErrorStatistics {
  std::size_t points = 0;    // asked for
  std::size_t measured = 0;  // that have a measured height
  double complete = 0;       // measured / points
  double median = 0, nmad = 0, rmse = 0;
  double p90 = 0, p99 = 0;             // of the absolute error
  double beyond_5 = 0, beyond_10 = 0;  // shares of the measured
};
[[nodiscard]] ErrorStatistics statisticsOf(std::vector<double> errors_in_gsd, std::size_t points);

// The map's height at a place: bilinear between texel centres; nullopt where one of the four is not measured
// (or, with `filled`, has no height at all).
[[nodiscard]] std::optional<double> heightAt(const std::map<geo::TileKey, Tile>& tiles,
                                             const geo::TileLattice& lattice, int zoom, double anchor_px,
                                             const geo::Geodetic& place, bool filled = false);

struct Comparison {
  ErrorStatistics strong;  // seen by at least `strong_track` frames
  ErrorStatistics all;
  int strong_track = 0;
};
// Strong points: tracks of at least the mean length, where the reference's own noise hides less; 0 takes it.
[[nodiscard]] Comparison compare(const std::map<geo::TileKey, Tile>& tiles, const geo::TileLattice& lattice,
                                 int zoom, double anchor_px, std::span<const ReferencePoint> points,
                                 double gsd_m, int strong_track = 0);

}  // namespace overfly::tiling
