#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace overfly::scene {

// Every effect that a scene may name. The order is the order of light and data: what happens in the air and
// in the lens comes before the sensor, the sensor before the stream; a scene's own order does not matter.
enum class Effect {
  WindSway,  // vegetation moves
  Vehicles,  // moving cars
  SunShadows,
  CloudShadows,
  Specular,  // water and windows mirror sun and sky
  RollingShutter,
  Haze,
  Defocus,
  MotionBlur,
  LensDistortion,
  Vignetting,
  ExposureDrift,  // exposure and white balance
  SensorNoise,
  Jpeg,
  GnssNoise,
  AttitudeNoise,
  Mounting,  // boresight and lever-arm error
  TimeDelay,
  DroppedPoses,   // and late ones
  DroppedFrames,  // and duplicated and late ones
};
inline constexpr int kEffectCount = static_cast<int>(Effect::DroppedFrames) + 1;

// One parameter of an effect: its TOML key with the unit in its name, its default and what raising it does.
struct EffectParameter {
  std::string_view key;
  double value;  // default
  double least;
  double most;
  std::string_view meaning;
};

struct EffectInfo {
  Effect effect;
  std::string_view name;  // in TOML: effects = ["name"], [effect.name]
  std::string_view meaning;
  std::vector<EffectParameter> parameters;
};

// Table of all effects, in order.
[[nodiscard]] const std::vector<EffectInfo>& allEffects();
[[nodiscard]] const EffectInfo& infoOf(Effect effect);
[[nodiscard]] std::optional<Effect> effectNamed(std::string_view name);

// An effect that a scene names, with its parameters (defaults filled in) and its own seed. The seed depends
// on the scene's seed and the effect's name alone, so that naming an effect changes nothing but that effect.
struct EffectSettings {
  Effect effect = Effect::SunShadows;
  std::map<std::string, double, std::less<>> values;
  std::uint32_t seed = 0;

  [[nodiscard]] double operator[](std::string_view key) const { return values.find(key)->second; }
};

// The effect with its defaults, as a scene with this seed would name it.
[[nodiscard]] EffectSettings defaultSettings(Effect effect, std::uint32_t scene_seed);

// The named effect among those of a scene, or null.
[[nodiscard]] const EffectSettings* findEffect(const std::vector<EffectSettings>& effects, Effect effect);

}  // namespace overfly::scene
