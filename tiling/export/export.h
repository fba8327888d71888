#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "capture/frame.h"
#include "config/error.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling {

enum class ExportFormat {
  GeoTiff,    // cloud-optimised, one zoom, any CRS: .tif, .tiff
  MbTiles,    // .mbtiles
  PmTiles,    // version 3: .pmtiles
  XyzFolder,  // Z/X/Y.EXT: a path without an ending, or one that is a folder
};

struct ExportOptions {
  Layer layer = Layer::Color;  // a picture, Elevation or Quality
  std::optional<int> zoom;     // the finest to export; absent: level 0, else the finest there is
  // GeoTIFF only. The target CRS: an EPSG code, or the UTM zone of the map's middle; absent: the lattice's.
  std::optional<int> epsg;
  bool utm = false;
  // GeoTIFF's elevation: heights above the ellipsoid or the geoid. Absent: as the map has them. BadInput for
  // a map whose heights count from the start of the flight or are unknown: there is nothing to convert by.
  std::optional<capture::VerticalDatum> datum;
  std::string geoid_grid;      // .gtx; empty: geo::Geoid::kDefaultGrid
  bool measured_only = false;  // what was interpolated or provisional becomes no data
};

struct ExportReport {
  std::uint64_t tiles = 0;
  std::uint64_t damaged_tiles = 0;  // left out; `overfly map check` names them
  std::uint64_t bytes = 0;          // of the file, or of all files in the folder
  int min_zoom = 0, max_zoom = 0;
};

// By the path's ending; BadInput for one that is none of ours.
[[nodiscard]] Result<ExportFormat> exportFormat(const std::filesystem::path& out);

// Gets the share done, 0..1, and ends the export by returning false.
using ExportProgress = std::function<bool(double)>;

// Writes the map's layer to `out`, which must not exist (an empty folder may); it appears when it is whole.
// MBTiles, PMTiles and folders hold every zoom up to the chosen one as web tiles: colours as they are stored,
// heights as Terrarium PNG (metres = 256 R + G + B / 256 - 32768, in the map's datum), quality as
// a coloured PNG (red: none, over yellow, to green: certain; blue tint where not measured). They
// need the Web Mercator lattice.
// A GeoTIFF holds colours as RGBA, heights as float32 with NaN for no data and the vertical reference in its
// CRS where the map knows one, quality as bytes: confidence, views, kind.
// Blocking; uses `reader` on the calling thread.
[[nodiscard]] Result<ExportReport> exportMap(const MapReader& reader, const std::filesystem::path& out,
                                             const ExportOptions& options,
                                             const ExportProgress& progress = {});

}  // namespace overfly::tiling
