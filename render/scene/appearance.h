#pragma once
#include "render/scene/cover.h"
#include "render/scene/glsl.h"

namespace overfly::scene {

// shaders/material.glsl and shaders/foliage.glsl as C++: what surfaces look like. Borrows the cover map.
// Reentrant.
class Appearance {
 public:
  Appearance(const CoverMap& cover, double kerb_width, bool street_lines);

  // Linear albedo; see material.glsl for the arguments.
  [[nodiscard]] glsl::vec3 ground(glsl::vec2 p, float width) const;
  [[nodiscard]] glsl::vec3 solid(std::uint32_t surface, glsl::vec2 uv, float width) const;
  [[nodiscard]] static float leafCover(glsl::vec2 uv, float metres, std::uint32_t clump);
  [[nodiscard]] static glsl::vec3 leaf(std::uint32_t species, std::uint32_t seed, glsl::vec2 uv, float metres,
                                       float depth, float width, std::uint32_t clump);
  [[nodiscard]] static glsl::vec3 radiance(glsl::vec3 albedo, glsl::vec3 normal, glsl::vec3 towards_sun,
                                           float lit);
  [[nodiscard]] static glsl::vec3 encoded(glsl::vec3 radiance);

 private:
  const CoverMap* cover_;
  float kerb_width_;
  float street_lines_;
};

}  // namespace overfly::scene
