#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "capture/camera_model.h"
#include "capture/geo/tile_frame.h"
#include "capture/pose.h"
#include "config/error.h"
#include "render/gl/context.h"
#include "render/gl/texture.h"

namespace overfly::tiling {

// One frame to take colour from. Borrowed for the call.
struct OrthoView {
  std::uint64_t frame_id = 0;
  const gl::Texture* color = nullptr;  // RGBA8, alpha: valid
  capture::CameraModel camera;         // Pinhole
  capture::Pose pose;
  float gain = 1;   // exposure gain of the frame, see ExposureBalance
  float worth = 1;  // of the frame as a whole: sharpness relative to its neighbours
};

// Which of several views colours a texel whose height is only a guess (thesis 5.4, figure 5.6).
enum class Fallback {
  ImageCentre,  // the one that sees it nearest to its image's centre: fewest lateral surfaces
  Blend,        // all, less towards the border of an image
  Average,      // all alike
  Overwrite,    // the one given last
  LowestCost,   // the one that differs least from the others
};

// The surface over a cell, side x side, with `apron` texels around the cell's `texels`.
struct OrthoSurface {
  const geo::TileFrame* frame = nullptr;
  int texels = 0;
  int apron = 0;
  std::span<const float> height;              // ellipsoidal, metres; finite everywhere
  std::span<const std::uint8_t> provisional;  // 1 where the height is only a guess
};

// size x size texels over the cell, row 0 north.
struct Orthophoto {
  int size = 0;
  std::vector<std::uint8_t> color;        // RGBA8, alpha 0: no frame covers the texel
  std::vector<std::uint16_t> source;      // index into the views given, 65535: none
  std::vector<std::uint8_t> seen_by;      // frames that see the texel, occlusion considered
  std::vector<std::uint8_t> provisional;  // 1: plain projection onto a guessed surface
  std::vector<float> gsd_m;               // of the source at the texel; 0: none
  std::vector<float> tilt;                // of the source's line of sight from the vertical, radians
};

// Colours a surface (thesis 5.4, made a true orthophoto by testing occlusion along the ray to each camera).
// The view with the smallest angle from straight down wins; two that are nearly equal are mixed, so that
// no seam shows; a texel that no view sees is coloured by the least bad one. On a guessed surface `fallback`
// decides.
// Thread-bound to the context's thread. Deterministic.
class Orthographer {
 public:
  static constexpr int kMaxViews = 13;  // with the three surface maps, within 16 texture units
  [[nodiscard]] static Result<std::unique_ptr<Orthographer>> create(gl::Context& context);
  ~Orthographer();
  [[nodiscard]] Result<Orthophoto> render(const OrthoSurface& surface, std::span<const OrthoView> views,
                                          int size, Fallback fallback = Fallback::ImageCentre);

 private:
  struct Impl;
  explicit Orthographer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace overfly::tiling
