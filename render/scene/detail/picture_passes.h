#pragma once
#include <memory>
#include <string>
#include <vector>

#include "render/gl/commands.h"
#include "render/gl/context.h"
#include "render/gl/program.h"
#include "render/gl/texture.h"
#include "render/scene/detail/view.h"
#include "render/scene/effect_settings.h"
#include "render/scene/world.h"

namespace overfly::scene {

// One full-screen pass over the picture: program, and what it sets from the frame.
class PicturePass {
 public:
  virtual ~PicturePass() = default;
  PicturePass(gl::Program program, EffectSettings settings)
      : program_(std::move(program)), settings_(std::move(settings)) {}

  // Sets the uniforms of one frame.
  virtual void prepare(const View& view, int frame) = 0;
  // Whether it reads the geometry's depth, and whether its target has the sensor's size (from the lens on).
  [[nodiscard]] virtual bool readsDepth() const { return false; }

  void run(const gl::Texture& picture, const gl::Texture& depth, const View& view, gl::Framebuffer& target);
  [[nodiscard]] Effect effect() const { return settings_.effect; }

 protected:
  gl::Program program_;
  EffectSettings settings_;
};

struct PassContext {
  gl::Context& gl;
  const World& world;
  const capture::CameraModel& sensor;  // ideal lens
  const RenderCamera& ideal;           // what the geometry is drawn through
  const FlightPath& path;
};

// The passes that the effects name, in the order of the light; none for effects that are not passes.
[[nodiscard]] Result<std::vector<std::unique_ptr<PicturePass>>> makePasses(
    const PassContext& context, const std::vector<EffectSettings>& effects);

// Reads the geometry's depth into a plain R32F target.
[[nodiscard]] Result<gl::Program> makeDepthReader(gl::Context& context);
void setDepthInputs(gl::Program& program, const gl::Texture& depth, const View& view);

}  // namespace overfly::scene
