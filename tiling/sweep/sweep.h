#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "capture/camera_model.h"
#include "capture/geo/tile_frame.h"
#include "capture/pose.h"
#include "config/error.h"
#include "render/gl/context.h"
#include "render/gl/texture.h"

namespace overfly::tiling {

// How well the views agree at a height (thesis 5.1.1, 5.2). Zncc works on locally normalised images (see
// MatchImage), the others on luminance.
enum class MatchCost { Zncc, Sad, Ssd, Census };

struct SweepOptions {
  MatchCost cost = MatchCost::Zncc;
  int window_radius = 3;     // texels; support window of (2 r + 1)^2; larger: fewer errors, rounder edges
  int levels = 4;            // of the coarse-to-fine search, each twice as fine; 1: full range at the finest
  int finest_level = 0;      // where the search ends, below `levels`: 0 on the grid's own texels; each more
                             // takes a quarter of the time, and the field has half the resolution
  double plane_step = 0.8;   // distance of planes, in texels of parallax between two mean views
  int max_views = 12;        // at most kMaxViews
  int max_planes = 256;      // on the coarsest grid; a taller range is searched in wider steps
  bool better_half = false;  // of the views, by texel and plane, before the window (thesis 5.5.4)
  bool two_surfaces = true;  // at steps, search around the upper and the lower side of the coarse surface
  bool occlusion = true;     // views that the coarser surface hides from a texel do not count there
  int widenings = 2;         // how often the band moves on where the best plane lies at its edge
  bool regularise = false;   // semi-global aggregation over the planes, for weakly textured ground
  double path_penalty_step = 0.08;  // regularised: cost of a height change by one plane, in score
  double path_penalty_jump = 0.40;  // regularised: of any larger one
  double min_score = 0.20;          // below: no data. For Zncc the mean correlation over all pairs of views
  int median_radius = 2;            // texels; 0..2
  double smooth_planes = 1.0;  // edge-preserving smoothing: heights that differ by more planes do not mix
  int min_segment = 40;  // texels of the field; smaller islands that jump from all around them are removed
  // A height whose rival, elsewhere in the range, agrees at least this share as well is no data: the texture
  // repeats. Natural ground stays below 0.6. 1 or more: not asked for.
  double max_rival = 0.65;
  static constexpr int kMaxViews = 14;
  friend bool operator==(const SweepOptions&, const SweepOptions&) = default;
};

// One image of the set, as the sweep sees it. Borrowed for the call.
struct SweepView {
  std::uint64_t frame_id = 0;
  const gl::Texture* match = nullptr;  // R8, mip levels; see MatchImage
  capture::CameraModel camera;         // Pinhole; of mip level 0
  capture::Pose pose;
};

// The cell to sweep: texels x texels over the cell of `frame`, and `apron` more on every side.
struct SweepGrid {
  const geo::TileFrame* frame = nullptr;
  int texels = 256;
  int apron = 16;
  double ground_height_m = 0;  // ellipsoidal; typical, for the images' resolution on the ground
  double min_height_m = 0;     // the search range
  double max_height_m = 0;
};

// What came out: side() x side() values, row 0 north, the apron included.
struct HeightField {
  int texels = 0;                        // over the cell: the grid's, halved `halvings` times
  int apron = 0;                         // in texels of this field
  int halvings = 0;                      // the level where the search ended
  std::vector<float> height;             // ellipsoidal, metres; NaN: no data
  std::vector<float> score;              // agreement of the views, -1..1
  std::vector<std::uint8_t> confidence;  // 0..255, from score, shape of the cost curve and neighbours
  double plane_step_m = 0;               // of the finest level
  std::string reason;                    // why there is no data at all; empty otherwise
  std::uint64_t samples = 0;             // image samples read

  [[nodiscard]] int side() const { return texels + 2 * apron; }
};

// The space sweep (thesis, chapter 5), coarse to fine: on a grid 2^(levels-1) times coarser the whole height
// range, then on each finer grid seven planes around the upsampled surface, so that the planes follow the
// ground. GPU results are read back per level; filters run on the CPU. No earlier result is taken for a
// start: the whole range on the coarsest grid costs little, and so a cell depends on its views alone.
// Thread-bound to the context's thread. Deterministic.
class Sweeper {
 public:
  [[nodiscard]] static Result<std::unique_ptr<Sweeper>> create(gl::Context& context);
  ~Sweeper();

  // Unusable sets (fewer than two views, no baseline, no finite pose, cameras below the range) give a field
  // without data and the reason. Errors: Unavailable when the context was lost.
  [[nodiscard]] Result<HeightField> run(const SweepGrid& grid, std::span<const SweepView> views,
                                        const SweepOptions& options);

  // Called between the passes over a grid: others may use the context meanwhile. Answering false ends run()
  // with Unavailable.
  void onPause(std::function<bool()> pause);

  // The thesis' full sweep: all planes at the finest grid, costs Sad or Ssd, windows from mip levels 0..
  // `window_levels`-1 (5.11), all views or the better half (5.5.4). For comparison; no filter is applied.
  struct FullOptions {
    MatchCost cost = MatchCost::Sad;
    int window_levels = 1;
    bool better_half = false;
    double plane_step_m = 0.1;
  };
  [[nodiscard]] Result<HeightField> runFull(const SweepGrid& grid, std::span<const SweepView> views,
                                            const FullOptions& options);

 private:
  struct Impl;
  explicit Sweeper(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace overfly::tiling
