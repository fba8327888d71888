#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

#include "render/gl/framebuffer.h"
#include "render/gl/program.h"
#include "render/gl/texture.h"
#include "tiling/sweep/detail/hidden_views.h"
#include "tiling/sweep/detail/texel_blocks.h"
#include "tiling/sweep/detail/view_geometry.h"
#include "tiling/sweep/sweep.h"

namespace overfly::tiling::detail {

inline constexpr int kPlanes = 7;  // of one pass
inline constexpr int kCentre = 3;  // the plane at the base height

// What a pass finds at a texel, see window_best.frag. Heights count from ViewGeometry::reference_height_m.
struct Best {
  float height;
  float score;
  float plane;     // index of the best plane, 0..6
  float strength;  // texture strength that the score was divided by

  // What heights of one texel are compared by: where a plain surface is looked at, a score is noise.
  [[nodiscard]] float agreement() const { return score * strength; }
};

// One grid of the coarse-to-fine search. Borrowed for the calls.
struct Pass {
  const SweepGrid* grid;
  std::span<const SweepView> views;
  const SweepOptions* options;
  const ViewGeometry* geometry;
  int level;  // the grid's texels are 2^level times the finest ones
  double plane_step_m;
  std::vector<float> lods;  // mip level of each view's match image

  [[nodiscard]] int side() const { return (grid->texels >> level) + 2 * grid->apron; }
  [[nodiscard]] std::size_t count() const {
    return static_cast<std::size_t>(side()) * static_cast<std::size_t>(side());
  }
};

// A surface that may hide texels from views: of the next coarser grid, side x side heights.
struct Occluders {
  std::span<const float> height;
  int texels = 0;  // of the cell; the apron is the grid's
};

// The GPU side of the sweep: programs and textures, kept from tile to tile. Thread-bound to the context's
// thread.
class SweepPasses {
 public:
  explicit SweepPasses(gl::Context& context) : context_(&context), hidden_(context) {}

  // Called before every pass; false puts the sweep aside (Unavailable). See Sweeper::onPause.
  void onPause(std::function<bool()> pause) { pause_ = std::move(pause); }

  // The best of seven planes around base + offset at every texel. With a mask (1: wanted) only its texels are
  // made, the others are undefined; occluders go with a mask: a view does not count where they stand between it
  // and the texel. Adds the image samples read to `samples`.
  [[nodiscard]] Result<std::vector<Best>> best(const Pass& pass, std::span<const float> base, double offset_m,
                                               std::uint64_t& samples,
                                               std::span<const std::uint8_t> mask = {},
                                               const Occluders* occluders = nullptr);
  // The scores of the seven planes, kPlanes values a texel.
  [[nodiscard]] Result<std::vector<float>> scores(const Pass& pass, std::span<const float> base,
                                                  double offset_m, std::uint64_t& samples);

  // Sweeper::runFull's kernel: height, cost, views and number of planes with that cost, four values a texel.
  [[nodiscard]] Result<std::vector<float>> full(const SweepGrid& grid, std::span<const SweepView> views,
                                                const ViewGeometry& geometry,
                                                const Sweeper::FullOptions& options, int planes);

 private:
  using CostKey = std::tuple<int, int, bool, bool, bool>;  // cost, views, better half, masked, occluders
  using WindowKey = std::tuple<int, int, bool, bool>;      // radius, cost, raw, masked
  using FullKey = std::tuple<int, int, int, bool>;         // cost, views, levels, better half

  // The textures of one grid size.
  struct Targets {
    gl::Texture base, surface, a0, a1, b0, b1, best, hidden;
    gl::Framebuffer into_a, into_b, into_best, into_hidden;
    TexelBlocks wanted;
  };

  Result<gl::Program*> costProgram(const CostKey& key);
  Result<gl::Program*> windowProgram(std::map<WindowKey, gl::Program>& programs, const gl::ShaderFile& file,
                                     const WindowKey& key);
  Result<Targets*> targetsOf(int side);
  // Marks the views that the occluders hide from each texel in targets.hidden; false when none can.
  Result<bool> findHidden(const Pass& pass, Targets& targets, double lowest_base_m, double offset_m,
                          const Occluders& occluders);
  Result<Targets*> windowSums(const Pass& pass, std::span<const float> base, double offset_m,
                              std::uint64_t& samples, std::span<const std::uint8_t> mask,
                              const Occluders* occluders);

  gl::Context* context_;
  HiddenViews hidden_;
  std::function<bool()> pause_;
  std::map<CostKey, gl::Program> cost_programs_;
  std::map<WindowKey, gl::Program> row_programs_, best_programs_;
  std::map<FullKey, gl::Program> full_programs_;
  std::map<int, Targets> targets_;
};

}  // namespace overfly::tiling::detail
