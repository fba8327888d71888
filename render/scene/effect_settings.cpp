#include "render/scene/effect_settings.h"

#include <algorithm>

#include "render/scene/random.h"

namespace overfly::scene {

const std::vector<EffectInfo>& allEffects() {
  static const std::vector<EffectInfo> table = {
      {Effect::WindSway,
       "wind_sway",
       "crowns of trees sway",
       {{"amplitude_m", 0.15, 0, 2, "of a crown's top"}, {"period_s", 2.5, 0.2, 60, "of one sway"}}},
      {Effect::Vehicles,
       "vehicles",
       "cars drive on the streets",
       {{"per_kilometre", 20, 0, 200, "cars on a street"}, {"speed_mps", 10, 0, 60, "of each car"}}},
      {Effect::SunShadows,
       "sun_shadows",
       "what stands in the sun throws a shadow",
       {{"map_size", 2048, 256, 8192, "side of the shadow map, texels"}}},
      {Effect::CloudShadows,
       "cloud_shadows",
       "shadows of clouds wander over the ground",
       {{"cover", 0.4, 0, 1, "share of the ground in shadow"},
        {"depth", 0.6, 0, 1, "share of the light that a cloud takes"},
        {"size_m", 60, 5, 2000, "of a cloud"},
        {"speed_mps", 6, 0, 60, "of the clouds, towards the east"}}},
      {Effect::Specular,
       "specular",
       "water and windows mirror the sun",
       {{"strength", 1.5, 0, 20, "of the mirrored sun, in units of white"},
        {"roughness", 0.08, 0.005, 1, "of the water, tangent of the slope"}}},
      {Effect::RollingShutter,
       "rolling_shutter",
       "rows are exposed one after the other",
       {{"line_time_us", 20, 0, 200, "between two rows, microseconds"}}},
      {Effect::Haze,
       "haze",
       "air between camera and ground",
       {{"visibility_m", 3000, 50, 100000, "distance at which contrast falls to 2 %"}}},
      {Effect::Defocus,
       "defocus",
       "the lens is not focused on the ground",
       {{"focus_m", 20, 0.1, 100000, "distance in focus"},
        {"aperture_mm", 1.5, 0.01, 100, "diameter of the entrance pupil"}}},
      {Effect::MotionBlur,
       "motion_blur",
       "the camera moves during the exposure",
       {{"exposure_ms", 4, 0, 200, "of each frame"}}},
      {Effect::LensDistortion,
       "lens_distortion",
       "OpenCV's k1 k2 p1 p2 k3",
       {{"k1", -0.12, -1, 1, ""},
        {"k2", 0.03, -1, 1, ""},
        {"p1", 0.0005, -0.1, 0.1, ""},
        {"p2", -0.0004, -0.1, 0.1, ""},
        {"k3", 0, -1, 1, ""}}},
      {Effect::Vignetting,
       "vignetting",
       "corners are darker",
       {{"strength", 1, 0, 4, "exponent on cos^4 of the angle off the axis"}}},
      {Effect::ExposureDrift,
       "exposure_drift",
       "exposure and white balance wander",
       {{"exposure_stops", 0.25, 0, 3, "1 sigma"},
        {"white_balance", 0.04, 0, 0.5, "1 sigma of the red and blue gains"},
        {"time_constant_s", 10, 0.1, 1000, "of the wandering"}}},
      {Effect::SensorNoise,
       "sensor_noise",
       "shot and read noise",
       {{"gain", 4, 1, 1000, "of the sensor, linear"},
        {"full_well_e", 9000, 100, 1e6, "electrons at saturation with gain 1"},
        {"read_noise_e", 3, 0, 100, "1 sigma, electrons"}}},
      {Effect::Jpeg,
       "jpeg",
       "frames are compressed",
       {{"quality", 85, 5, 100, "libjpeg's"}, {"subsampling", 1, 0, 1, "1: chroma at half size"}}},
      {Effect::GnssNoise,
       "gnss_noise",
       "position from GNSS",
       {{"horizontal_m", 1.2, 0, 100, "1 sigma of the wandering part, each axis"},
        {"vertical_m", 2.0, 0, 100, "1 sigma of the wandering part"},
        {"time_constant_s", 60, 0.1, 10000, "of the wandering"},
        {"white_m", 0.03, 0, 10, "1 sigma of the white part"},
        {"jumps_per_minute", 0, 0, 60, "multipath"},
        {"jump_m", 2, 0, 100, "1 sigma of a jump"},
        {"jump_s", 8, 0.1, 600, "how long a jump lasts"}}},
      {Effect::AttitudeNoise,
       "attitude_noise",
       "attitude from the autopilot",
       {{"white_deg", 0.1, 0, 20, "1 sigma, each axis"},
        {"drift_deg", 0.5, 0, 20, "1 sigma of the wandering part of roll and pitch"},
        {"heading_drift_deg", 1.5, 0, 90, "1 sigma of the wandering part of the heading"},
        {"time_constant_s", 30, 0.1, 10000, "of the wandering"}}},
      {Effect::Mounting,
       "mounting",
       "boresight and lever arm are not what the settings say",
       {{"roll_deg", 0.6, -30, 30, "boresight"},
        {"pitch_deg", -0.8, -30, 30, "boresight"},
        {"yaw_deg", 0.5, -180, 180, "boresight"},
        {"forward_m", 0.1, -5, 5, "lever arm"},
        {"right_m", 0, -5, 5, "lever arm"},
        {"down_m", -0.15, -5, 5, "lever arm"}}},
      {Effect::TimeDelay,
       "time_delay",
       "poses are stamped late",
       {{"delay_ms", 150, -5000, 5000, "the recorded pose is older than the frame by this"}}},
      {Effect::DroppedPoses,
       "dropped_poses",
       "poses are missing or late",
       {{"dropped", 0.05, 0, 1, "share of frames without a pose"},
        {"late", 0.05, 0, 1, "share of frames with the previous frame's pose"}}},
      {Effect::DroppedFrames,
       "dropped_frames",
       "frames are lost, doubled or late",
       {{"dropped", 0.05, 0, 1, "share of lost frames"},
        {"duplicated", 0.03, 0, 1, "share of frames whose picture is the previous one's"},
        {"late", 0.05, 0, 1, "share of frames handed on late"},
        {"late_ms", 400, 0, 60000, "how late"}}},
  };
  return table;
}

const EffectInfo& infoOf(Effect effect) { return allEffects()[static_cast<std::size_t>(effect)]; }

std::optional<Effect> effectNamed(std::string_view name) {
  for (const EffectInfo& info : allEffects()) {
    if (info.name == name) return info.effect;
  }
  return std::nullopt;
}

EffectSettings defaultSettings(Effect effect, std::uint32_t scene_seed) {
  EffectSettings settings;
  settings.effect = effect;
  const EffectInfo& info = infoOf(effect);
  for (const EffectParameter& parameter : info.parameters) {
    settings.values.emplace(std::string(parameter.key), parameter.value);
  }
  settings.seed = seedOf(scene_seed, info.name);
  return settings;
}

const EffectSettings* findEffect(const std::vector<EffectSettings>& effects, Effect effect) {
  const auto found = std::find_if(effects.begin(), effects.end(),
                                  [&](const EffectSettings& settings) { return settings.effect == effect; });
  return found == effects.end() ? nullptr : &*found;
}

}  // namespace overfly::scene
