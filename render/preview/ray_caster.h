#pragma once
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "render/gl/context.h"
#include "render/gl/framebuffer.h"
#include "render/gl/program.h"
#include "render/preview/clip_cache.h"
#include "render/preview/look.h"
#include "render/preview/map_textures.h"
#include "render/preview/projector_textures.h"
#include "render/preview/view.h"

namespace overfly::preview {

// Where a ray ended.
struct RayHit {
  bool found = false;
  double t = 0;                 // metres
  Eigen::Vector2d texel{0, 0};  // level-0 texels from the domain's corner
  double height_m = 0;          // in the map's datum
  int level = 0;                // that was drawn
  int steps = 0;                // cells that were looked at
  bool gave_up = false;         // the bound on steps was reached: a fault
};

struct Picture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;  // row 0 at the top
  std::vector<RayHit> hits;        // of every pixel, when asked for
};

struct SingleRay {
  Eigen::Vector3d start{0, 0, 0};  // from the frame's start: texels, texels, metres
  Eigen::Vector3d direction;       // East-North-Up, unit length
  double levels_per_metre = 0;     // 0: the finest level everywhere
};

// Single-pass ray casting of what the clip cache holds (thesis, chapter 4). Thread-bound to its context.
class RayCaster {
 public:
  explicit RayCaster(gl::Context& context) : context_(&context) {}

  // Internal: the shader does not compile; Unavailable: the context was lost.
  [[nodiscard]] Result<Picture> draw(const View& view, const RayFrame& frame, const Look& look,
                                     const ClipCache& cache, const MapTextures& textures, bool hits = false);
  // Draws without reading back, for measurements.
  [[nodiscard]] Result<void> drawOnly(const View& view, const RayFrame& frame, const Look& look,
                                      const ClipCache& cache, const MapTextures& textures);
  // Single rays, up to `length_m` long, prepared in double: as exact as the frame is.
  [[nodiscard]] Result<std::vector<RayHit>> cast(std::span<const SingleRay> rays, const RayFrame& frame,
                                                 Surface surface, double length_m, const ClipCache& cache,
                                                 const MapTextures& textures);
  // The photographs for pictures whose look asks for some (Look::projectors), from now on; null: none. They
  // outlive the caster, or this is called again.
  void project(const ProjectorTextures* projectors) { projectors_ = projectors; }
  // For comparisons: start every ray at level 0 and never go up, as if there were no pyramid.
  void usePyramid(bool use) { pyramid_ = use; }

 private:
  struct Targets {
    gl::Texture color, where, how;
    gl::Framebuffer framebuffer;
  };
  [[nodiscard]] Result<gl::Program*> program(const std::string& fragment,
                                             const std::vector<gl::Define>& defines);
  [[nodiscard]] Result<Targets*> targets(int width, int height, bool color, bool hits);
  void setFrame(gl::Program& program, const RayFrame& frame, const ClipCache& cache, double length_m,
                const Chords& chords);
  [[nodiscard]] Result<Targets*> render(const View& view, const RayFrame& frame, const Look& look,
                                        const ClipCache& cache, const MapTextures& textures, bool hits);

  gl::Context* context_;
  std::map<std::string, gl::Program> programs_;
  std::map<std::string, Targets> targets_;
  const ProjectorTextures* projectors_ = nullptr;
  bool pyramid_ = true;
};

}  // namespace overfly::preview
