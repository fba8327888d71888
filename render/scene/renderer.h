#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "capture/camera_model.h"
#include "render/gl/context.h"
#include "render/scene/effect_graph.h"
#include "render/scene/flight_path.h"
#include "render/scene/ray_tracer.h"
#include "render/scene/world.h"

namespace overfly::scene {

// What one frame cost. Passes are render targets drawn into: the geometry is one, the shadow map another,
// every picture effect one.
struct FrameCost {
  struct Pass {
    std::string name;
    double milliseconds = 0;  // 0 unless measured
  };
  std::vector<Pass> passes;
  int draws = 0;
  std::size_t triangles = 0;
  std::size_t plants = 0;
};

// Makes the frames of a flight on the GPU (or Mesa's software rasteriser). Only the effects that the scene
// names exist: their programs, textures and random streams are made in create(), nothing is switched off at
// run time. A frame depends on the scene and its number alone: the same bytes on every run on one machine.
// Bound to the context's thread.
class Renderer {
 public:
  [[nodiscard]] static Result<std::unique_ptr<Renderer>> create(gl::Context& context,
                                                                std::shared_ptr<const World> world);
  ~Renderer();

  // Frame of the flight path, with the effects on its picture; 0 <= frame < path().frames().
  [[nodiscard]] Result<Picture> render(int frame);
  // A picture from anywhere, at rest unless `motion` says otherwise; `frame` seeds what is random.
  [[nodiscard]] Result<Picture> render(const CameraState& state, const CameraMotion& motion, double time_s,
                                       int frame);
  // Depth along the axis of each pixel of the last frame's ideal (undistorted) picture, metres, float32.
  [[nodiscard]] Result<std::vector<float>> depth();

  // Waits after every pass, so that lastCost() carries times; costs a little.
  void measure(bool on);
  [[nodiscard]] const FrameCost& lastCost() const;
  [[nodiscard]] const FlightPath& path() const;
  // The camera as the frames show it: with the lens distortion, if the scene names it.
  [[nodiscard]] const capture::CameraModel& camera() const;

 private:
  class Impl;
  explicit Renderer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// The camera that the frames of a scene are seen through: the ideal lens, or with lens_distortion.
[[nodiscard]] capture::CameraModel effectiveCamera(const SceneDescription& scene);

}  // namespace overfly::scene
