#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "capture/frame.h"
#include "capture/geo/tile_lattice.h"
#include "config/error.h"
#include "render/gl/context.h"
#include "tiling/index/frame_index.h"
#include "tiling/index/recent_frames.h"
#include "tiling/index/view_selection.h"
#include "tiling/mapping/thumbnail.h"
#include "tiling/sweep/match_image.h"
#include "tiling/sweep/orthophoto.h"
#include "tiling/sweep/sweep.h"
#include "tiling/tile.h"

namespace overfly::tiling {

struct MapperOptions {
  SweepOptions sweep;
  MatchImageOptions match;
  ViewSelectionOptions views;  // max_views is taken from `sweep`
  IndexedFrameOptions frames;  // which of them make tiles
  int tile_size = 256;         // texels of a tile
  RecencyOptions recency;      // which frames count where there are more than enough
  // Share of the frames' resolution that is matched: the sweep's texel is 2^k times the map's, the finest
  // that is not finer than 0.9 GSD / working_scale. At 1, heights below the images' resolution only cost
  // time. Where the frames of a cell are coarser than the first ones, which settled the cells, it is swept
  // that much coarser.
  double working_scale = 1;
  Fallback fallback = Fallback::ImageCentre;  // where a texel has no height
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

// What settles the map's place and resolution beside the first frames.
struct GroundOptions {
  int tile_size = 256;
  std::optional<double> height_m;  // known typical ground instead of the estimate from the images
  std::optional<double> gsd_m;     // wanted for level 0 instead of the frames' median
  // Search range around the ground; 0: from the height of flight, and the slope that the images show.
  double search_above_m = 0, search_below_m = 0;
};

struct MapperStatistics {
  std::uint64_t frames = 0, cells_swept = 0, cells_finished = 0, tiles = 0, samples = 0;
  double rectify_s = 0, match_s = 0, sweep_s = 0, blend_s = 0, ortho_s = 0;
  // Processor time of all threads of the process while match images were made and cells swept.
  double sweep_processor_s = 0;
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
  [[nodiscard]] static Result<MapGround> settleGround(std::span<const Thumbnail> first_frames,
                                                      std::span<const capture::CameraModel> cameras,
                                                      const geo::TileLattice& lattice,
                                                      const GroundOptions& options = {});
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

  // Equalises the exposures of all frames so far, in steps of 1 %. Returns the cells of frames whose gain
  // changed: their colour is to be made again.
  [[nodiscard]] std::vector<geo::TileKey> balanceExposure();

  // Sweeps a cell if its frame set, or the options of the sweep, have changed since it was last swept. True
  // when it now has heights that it did not have before: the cell and its eight neighbours are to be
  // finished.
  [[nodiscard]] Result<bool> sweepCell(const geo::TileKey& cell);

  // The level-0 tiles of a cell: blends the heights with those of the neighbouring cells, fills small holes,
  // colours. Empty tiles are left out. `Around::Current` sweeps the cell and its neighbours where their frame
  // sets have changed. `Around::AsSwept` takes cell and neighbours as they were last swept, neighbours never
  // swept for empty: for a map in the making, whose changed cells all have their own turn.
  enum class Around { Current, AsSwept };
  [[nodiscard]] Result<std::vector<Tile>> finishCell(const geo::TileKey& cell,
                                                     Around around = Around::Current);

  // Colour at once: the frames projected onto the plane of the typical ground (or what heights there are),
  // marked as provisional.
  [[nodiscard]] Result<std::vector<Tile>> provisionalCell(const geo::TileKey& cell);

  // The cell's frames on a surface that is given: heights of the cell and its eight neighbours, row by row
  // from north-west, each as many texels as the cell's tiles have, NaN for none; an empty one lacks them all.
  // Where the cell has no height there is no colour.
  [[nodiscard]] Result<std::vector<Tile>> colourOn(const geo::TileKey& cell,
                                                   const std::array<std::vector<float>, 9>& heights);

  // Makes anew what it has on the GPU, in `context`: the old context was lost, or memory ran out (then with
  // half of it for decoded frames, at least kLeastFrameBytes). Everything else stays: swept cells are kept,
  // frames are loaded again when they are needed. After an error only renew() may be called.
  static constexpr std::size_t kLeastFrameBytes = 64u << 20;
  [[nodiscard]] Result<void> renew(gl::Context& context, bool less_memory = false);

  // How cells are swept and finished from now on; sizes, scale and memory stay as they were made.
  void setOptions(const MapperOptions& options);

  // Called between the passes of a sweep and of an orthophoto, some tens of milliseconds apart on a software
  // rasteriser: others may use the context meanwhile. Answering false ends the call that is under way with
  // Unavailable, and nothing of it is kept. None at the start.
  void onPause(std::function<bool()> pause);

  // Row by row from the north, as a batch goes through them.
  [[nodiscard]] static std::vector<geo::TileKey> rowByRow(const std::set<geo::TileKey>& cells);
  [[nodiscard]] static std::vector<geo::TileKey> neighboursOf(
      const geo::TileKey& cell);  // 3x3, itself included
  [[nodiscard]] const MapperStatistics& statistics() const;

 private:
  struct Impl;
  explicit Mapper(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace overfly::tiling
