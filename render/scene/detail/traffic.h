#pragma once
#include "render/scene/effect_settings.h"
#include "render/scene/world.h"

namespace overfly::scene {

// Cars that drive on the streets of a world: where they are is a function of time. Reentrant; borrows the
// world. They are no part of the truth.
class Traffic {
 public:
  Traffic(const World& world, const EffectSettings& settings) : world_(world), settings_(settings) {}

  // The cars at a time, one chunk; the same triangles in the same order every time.
  [[nodiscard]] Mesh meshAt(double time_s) const;

 private:
  const World& world_;
  EffectSettings settings_;
};

}  // namespace overfly::scene
