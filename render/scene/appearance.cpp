#include "render/scene/appearance.h"

namespace overfly::scene {
namespace glsl {
namespace {

// The shader text, with what are uniforms and samplers there as members.
struct ShaderText {
  const CoverMap* cover = nullptr;
  float kerb_width = 0;
  float street_lines = 0;

  [[nodiscard]] uint coverTexel(int x, int y) const { return cover->at(x, y); }
  [[nodiscard]] vec2 coverOrigin() const {
    return {static_cast<float>(cover->origin().x()), static_cast<float>(cover->origin().y())};
  }
  [[nodiscard]] float coverTexelsPerMetre() const { return static_cast<float>(1.0 / cover->texel()); }
  [[nodiscard]] float kerbWidth() const { return kerb_width; }
  [[nodiscard]] float streetLines() const { return street_lines; }

#include "render/scene/shaders/foliage.glsl"
// Order matters: each file uses the one before.
#include "render/scene/shaders/material.glsl"
#include "render/scene/shaders/noise.glsl"
#include "render/scene/shaders/response.glsl"
};

}  // namespace
}  // namespace glsl

Appearance::Appearance(const CoverMap& cover, double kerb_width, bool street_lines)
    : cover_(&cover),
      kerb_width_(static_cast<float>(kerb_width)),
      street_lines_(street_lines ? 1.0f : 0.0f) {}

glsl::vec3 Appearance::ground(glsl::vec2 p, float width) const {
  return glsl::ShaderText{cover_, kerb_width_, street_lines_}.groundAlbedo(p, width);
}

glsl::vec3 Appearance::solid(std::uint32_t surface, glsl::vec2 uv, float width) const {
  return glsl::ShaderText{cover_, kerb_width_, street_lines_}.solidAlbedo(surface & 255u, surface >> 8, uv,
                                                                          width);
}

float Appearance::leafCover(glsl::vec2 uv, float metres, std::uint32_t clump) {
  return glsl::ShaderText{}.leafCover(uv, metres, clump);
}

glsl::vec3 Appearance::leaf(std::uint32_t species, std::uint32_t seed, glsl::vec2 uv, float metres,
                            float depth, float width, std::uint32_t clump) {
  return glsl::ShaderText{}.leafAlbedo(species, seed, uv, metres, depth, width, clump);
}

glsl::vec3 Appearance::radiance(glsl::vec3 albedo, glsl::vec3 normal, glsl::vec3 towards_sun, float lit) {
  return glsl::ShaderText{}.radianceOf(albedo, normal, towards_sun, lit);
}

glsl::vec3 Appearance::encoded(glsl::vec3 radiance) { return glsl::ShaderText{}.encoded(radiance); }

}  // namespace overfly::scene
