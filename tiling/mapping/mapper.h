#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "capture/frame.h"
#include "capture/geo/tile_lattice.h"
#include "config/error.h"
#include "render/gl/context.h"
#include "tiling/index/frame_index.h"
#include "tiling/index/view_selection.h"
#include "tiling/mapping/thumbnail.h"
#include "tiling/sweep/match_image.h"
#include "tiling/sweep/sweep.h"
#include "tiling/tile.h"

namespace overfly::tiling {

struct MapperOptions {
  SweepOptions sweep;
  MatchImageOptions match;
  ViewSelectionOptions views;  // max_views is taken from `sweep`
  int tile_size = 256;         // texels of a tile
  // The sweep's texel is 2^working_scale times the map's: -1 takes the finest that is not finer than
  // 0.9 GSD, because heights below the images' resolution only cost time.
  int working_scale = -1;
  int hole_texels = 400;  // largest hole (sweep texels) that is filled from its neighbours
  std::size_t frame_cache_bytes = 600u << 20;
  int field_cache = 400;  // swept cells kept; a cell that has left is swept again when a neighbour asks
};

// The map's place and resolution, settled by its first frames and kept.
struct MapGround {
  geo::TileLattice lattice = geo::TileLattice::webMercator();
  int base_zoom = 0;                          // of level-0 tiles
  double gsd_m = 0;                           // median of the first frames
  double texel_m = 0;                         // of level 0, on the ground
  double height_m = 0;                        // typical ground
  double min_height_m = 0, max_height_m = 0;  // search range of the sweep
  double anchor_px = 0.5;                     // unwrapped plane x of the first frame
};

struct MapperStatistics {
  std::uint64_t frames = 0, cells_swept = 0, cells_finished = 0, tiles = 0, samples = 0;
  double rectify_s = 0, match_s = 0, sweep_s = 0, blend_s = 0, ortho_s = 0;
};

// From frames with pose to level-0 tiles: rectification, view selection, sweep, blending of neighbouring
// cells, true orthophoto. It sweeps cells: a cell is the lattice cell whose `tile_size` texels are the
// sweep's texels (2^working_scale tiles along a side).
//
// A tile is a function of the frames that see its cell and the neighbouring cells, and of the exposure gains;
// order of arrival does not matter. Thread-bound to the context's thread.
class Mapper {
 public:
  using Loader = std::function<Result<capture::FramePtr>()>;

  [[nodiscard]] static Result<std::unique_ptr<Mapper>> create(gl::Context& context,
                                                              const MapperOptions& options);
  ~Mapper();

  // A small grey version of a frame, to find the ground with. Takes the frame to the GPU.
  [[nodiscard]] Result<Thumbnail> thumbnailOf(std::uint64_t id, const capture::FramePtr& frame);

  // Settles lattice, zoom and height range from thumbnails of the first frames; called once, before addFrame.
  // `ground_height_m`: known typical ground instead of the estimate from the images. `gsd_m`: wanted ground
  // sampling distance of level 0 instead of the frames' median.
  [[nodiscard]] static Result<MapGround> settleGround(std::span<const Thumbnail> first_frames,
                                                      std::span<const capture::CameraModel> cameras,
                                                      const geo::TileLattice& lattice, int tile_size,
                                                      std::optional<double> ground_height_m = std::nullopt,
                                                      std::optional<double> gsd_m = std::nullopt);
  void setGround(const MapGround& ground);
  [[nodiscard]] const MapGround& ground() const;
  [[nodiscard]] int cellZoom() const;
  [[nodiscard]] const FrameIndex& index() const;

  // Takes a frame with pose into the index (and, decoded, to the GPU), or replaces it: its pose was
  // corrected. `load` is kept, to fetch the frame again when it has left the cache. Returns the cells that it
  // can improve (for a replaced frame, the old ones too); none for an oblique frame. BadInput: no usable pose
  // or image.
  [[nodiscard]] Result<std::vector<geo::TileKey>> addFrame(std::uint64_t id, const capture::FramePtr& frame,
                                                           Loader load);

  // Equalises the exposures of all frames so far. Returns the cells of frames whose gain changed by more
  // than `threshold` (relative): their colour is to be made again.
  [[nodiscard]] std::vector<geo::TileKey> balanceExposure(double threshold = 0.01);

  // Sweeps a cell if its frame set has changed since it was last swept. True when it now has heights that it
  // did not have before: the cell and its eight neighbours are to be finished.
  [[nodiscard]] Result<bool> sweepCell(const geo::TileKey& cell);

  // The level-0 tiles of a cell: blends the heights with those of the neighbouring cells, fills small holes,
  // colours. Sweeps what it needs. Empty tiles are left out.
  [[nodiscard]] Result<std::vector<Tile>> finishCell(const geo::TileKey& cell);

  // Colour at once: the frames projected onto the plane of the typical ground (or what heights there are),
  // marked as provisional.
  [[nodiscard]] Result<std::vector<Tile>> provisionalCell(const geo::TileKey& cell);

  [[nodiscard]] static std::vector<geo::TileKey> neighboursOf(
      const geo::TileKey& cell);  // 3x3, itself included
  [[nodiscard]] const MapperStatistics& statistics() const;

 private:
  struct Impl;
  explicit Mapper(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace overfly::tiling
