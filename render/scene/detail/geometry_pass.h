#pragma once
#include <array>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "render/amplify/selector.h"
#include "render/gl/buffer.h"
#include "render/gl/commands.h"
#include "render/gl/context.h"
#include "render/gl/framebuffer.h"
#include "render/gl/program.h"
#include "render/gl/texture.h"
#include "render/gl/vertex_array.h"
#include "render/scene/detail/traffic.h"
#include "render/scene/detail/view.h"
#include "render/scene/effect_settings.h"
#include "render/scene/foliage.h"
#include "render/scene/world.h"

namespace overfly::scene {

// What the geometry stage drew of a frame.
struct GeometryCounts {
  int passes = 0;  // render targets drawn into: 1, and 1 for the shadow map
  int draws = 0;
  std::size_t triangles = 0;
  std::size_t plants = 0;
};

// Rasterises the world: ground, solids and plants into four samples a pixel, resolved into one texture.
// Effects that change how geometry is drawn (rolling shutter, sun shadows, wind, specular) are variants of
// its shaders, made only when named. Thread-bound to its context; borrows world and context.
class GeometryPass {
 public:
  [[nodiscard]] static Result<std::unique_ptr<GeometryPass>> create(
      gl::Context& context, const World& world, const RenderCamera& camera,
      const capture::CameraModel& sensor, const std::vector<EffectSettings>& effects);

  // near_m and far_m of the view are set to what is in it.
  [[nodiscard]] Result<void> draw(View& view);

  [[nodiscard]] const gl::Texture& color() const { return color_; }
  // Four samples a pixel; z of View's projection.
  [[nodiscard]] const gl::Texture& depth() const { return samples_depth_; }
  [[nodiscard]] const GeometryCounts& counts() const { return counts_; }

 private:
  GeometryPass(const World& world, const RenderCamera& camera, const capture::CameraModel& sensor)
      : world_(world), camera_(camera), sensor_(sensor) {}
  [[nodiscard]] Result<void> build(gl::Context& context, const std::vector<EffectSettings>& effects);
  [[nodiscard]] Result<void> buildPrograms(gl::Context& context);
  [[nodiscard]] Result<void> buildFoliage(gl::Context& context);
  [[nodiscard]] Result<void> buildShadows(gl::Context& context);
  [[nodiscard]] Result<void> buildTraffic(gl::Context& context, const EffectSettings& settings);
  [[nodiscard]] Result<void> drawShadowMap(const View& view);
  void setView(gl::Program& program, const View& view);
  void setLight(gl::Program& program, const View& view);
  // Selects the view's plants and draws them.
  [[nodiscard]] Result<void> drawPlants(gl::Program& program, gl::Framebuffer& target,
                                        const amplify::PlantView& view, bool count);

  struct SunView {
    Eigen::Matrix3d light_from_scene = Eigen::Matrix3d::Identity();
    Eigen::Vector3d low{0, 0, 0}, high{1, 1, 1};  // bounds in the light's frame
  };

  const World& world_;
  RenderCamera camera_;
  capture::CameraModel sensor_;
  const EffectSettings* shadows_ = nullptr;
  const EffectSettings* rolling_ = nullptr;
  const EffectSettings* distortion_ = nullptr;
  const EffectSettings* specular_ = nullptr;
  const EffectSettings* wind_ = nullptr;
  std::vector<EffectSettings> effects_;
  std::vector<gl::Define> defines_;

  gl::Texture samples_color_, samples_depth_, color_, cover_, shadow_map_;
  gl::Framebuffer samples_, resolved_, shadow_target_;
  gl::Buffer ground_vertices_, ground_indices_, solid_vertices_, solid_indices_;
  gl::VertexArray ground_, solids_;
  gl::Program ground_program_, solid_program_, foliage_program_, shadow_program_, shadow_foliage_program_;
  struct Foliage {
    gl::Buffer polygons, indices;
    gl::VertexArray vertices;
    int count = 0;  // indices
  };
  std::optional<amplify::PlantSelector> selector_;
  std::array<Foliage, amplify::kPlantBins> foliage_;
  double tallest_m_ = 0;  // reach of a plant above its foot
  SunView sun_;
  struct Vehicles {
    Traffic traffic;
    gl::Buffer vertices, indices;
    gl::VertexArray array;
    int count = 0;  // indices
  };
  std::unique_ptr<Vehicles> vehicles_;  // only when named
  GeometryCounts counts_;
};

}  // namespace overfly::scene
