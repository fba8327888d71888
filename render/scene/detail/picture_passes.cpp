#include "render/scene/detail/picture_passes.h"

#include <array>
#include <cmath>

#include "render/scene/gauss_markov.h"
#include "render/scene/random.h"
#include "scene_shaders.h"

namespace overfly::scene {
namespace {

namespace text = overfly::shaders::scene;
using gl::ShaderFile;

constexpr ShaderFile kNoise{"noise.glsl", text::noise_glsl};
constexpr ShaderFile kPass{"pass.glsl", text::pass_glsl};
constexpr ShaderFile kDepth{"depth.glsl", text::depth_glsl};

Eigen::Vector4f lensOf(const RenderCamera& c) {
  return Eigen::Vector4d(c.fx, c.fy, c.cx, c.cy).cast<float>();
}
Eigen::Vector4f lensOf(const capture::CameraModel& c) {
  return Eigen::Vector4d(c.fx, c.fy, c.cx, c.cy).cast<float>();
}

class DepthPass : public PicturePass {
 public:
  using PicturePass::PicturePass;
  [[nodiscard]] bool readsDepth() const override { return true; }
};

class HazePass : public DepthPass {
 public:
  using DepthPass::DepthPass;
  void prepare(const View&, int) override {
    program_.set("extinction", static_cast<float>(3.912 / settings_["visibility_m"]));
  }
};

class CloudPass : public DepthPass {
 public:
  CloudPass(gl::Program program, EffectSettings settings, const Eigen::Vector3d& sun)
      : DepthPass(std::move(program), std::move(settings)), sun_(sun) {}
  void prepare(const View& view, int) override {
    program_.set("scene_from_camera_rotation",
                 Eigen::Matrix3f(view.state.enu_from_camera.toRotationMatrix().cast<float>()));
    program_.set("camera_in_scene", Eigen::Vector3f(view.state.position.cast<float>()));
    program_.set("towards_sun", Eigen::Vector3f(sun_.cast<float>()));
    // The octaves' sum is about normal with sigma 0.24: the threshold for the share of ground in shadow.
    const double threshold = 0.24 * std::sqrt(2.0) * -inverseErf(2 * settings_["cover"] - 1);
    program_.set("clouds", Eigen::Vector4d(threshold, settings_["depth"], settings_["size_m"],
                                           settings_["speed_mps"] * view.time_s)
                               .cast<float>()
                               .eval());
    program_.set("seed", settings_.seed);
  }

 private:
  // Winitzki's approximation, to 2e-3: the noise is no better known.
  static double inverseErf(double x) {
    x = std::clamp(x, -0.9999, 0.9999);
    const double l = std::log(1 - x * x), a = 2 / (3.14159265 * 0.147) + 0.5 * l;
    return std::copysign(std::sqrt(std::sqrt(a * a - l / 0.147) - a), x);
  }
  Eigen::Vector3d sun_;
};

class DefocusPass : public DepthPass {
 public:
  using DepthPass::DepthPass;
  void prepare(const View& view, int) override {
    program_.set("pupil",
                 Eigen::Vector2d(view.camera.fx * settings_["aperture_mm"] * 1e-3, settings_["focus_m"])
                     .cast<float>()
                     .eval());
  }
};

class MotionBlurPass : public DepthPass {
 public:
  using DepthPass::DepthPass;
  void prepare(const View& view, int) override {
    const double exposure_s = settings_["exposure_ms"] * 1e-3;
    program_.set("velocity", Eigen::Vector3f((exposure_s * view.motion.velocity).cast<float>()));
    program_.set("rotation", Eigen::Vector3f((exposure_s * view.motion.rotation).cast<float>()));
  }
};

class LensPass : public PicturePass {
 public:
  LensPass(gl::Program program, EffectSettings settings, const capture::CameraModel& sensor)
      : PicturePass(std::move(program), std::move(settings)), sensor_(sensor) {}
  void prepare(const View& view, int) override {
    program_.set("sensor", lensOf(sensor_));
    program_.set("ideal", lensOf(view.camera));
    const std::array<float, 5> k{static_cast<float>(settings_["k1"]), static_cast<float>(settings_["k2"]),
                                 static_cast<float>(settings_["p1"]), static_cast<float>(settings_["p2"]),
                                 static_cast<float>(settings_["k3"])};
    program_.set("distortion", std::span<const float>(k));
  }

 private:
  capture::CameraModel sensor_;
};

class VignettingPass : public PicturePass {
 public:
  VignettingPass(gl::Program program, EffectSettings settings, const capture::CameraModel& sensor)
      : PicturePass(std::move(program), std::move(settings)), sensor_(sensor) {}
  void prepare(const View&, int) override {
    program_.set("sensor", lensOf(sensor_));
    program_.set("strength", static_cast<float>(settings_["strength"]));
  }

 private:
  capture::CameraModel sensor_;
};

class ExposurePass : public PicturePass {
 public:
  ExposurePass(gl::Program program, EffectSettings settings, const FlightPath& path)
      : PicturePass(std::move(program), std::move(settings)) {
    std::vector<double> times;
    for (int frame = 0; frame < path.frames(); ++frame) times.push_back(path.timeOf(frame));
    const double tau = settings_["time_constant_s"];
    stops_ = gaussMarkov(hashOf(settings_.seed, 1), times, settings_["exposure_stops"], tau);
    red_ = gaussMarkov(hashOf(settings_.seed, 2), times, settings_["white_balance"], tau);
    blue_ = gaussMarkov(hashOf(settings_.seed, 3), times, settings_["white_balance"], tau);
  }
  void prepare(const View&, int frame) override {
    const auto i = static_cast<std::size_t>(frame) % stops_.size();
    const double exposure = std::exp2(stops_[i]);
    program_.set(
        "gains",
        Eigen::Vector3d(exposure * (1 + red_[i]), exposure, exposure * (1 + blue_[i])).cast<float>().eval());
  }

 private:
  std::vector<double> stops_, red_, blue_;
};

class NoisePass : public PicturePass {
 public:
  using PicturePass::PicturePass;
  void prepare(const View&, int frame) override {
    // At gain g the sensor's white is full_well / g electrons.
    program_.set("sensor_electrons",
                 Eigen::Vector2d(settings_["full_well_e"] / settings_["gain"], settings_["read_noise_e"])
                     .cast<float>()
                     .eval());
    program_.set("seed", hashOf(settings_.seed, static_cast<std::uint32_t>(frame)));
  }
};

}  // namespace

void setDepthInputs(gl::Program& program, const gl::Texture& depth, const View& view) {
  program.setTexture("depth_samples", 1, depth);
  program.set("depth_range", Eigen::Vector2d((view.far_m + view.near_m) / (view.far_m - view.near_m),
                                             -2 * view.far_m * view.near_m / (view.far_m - view.near_m))
                                 .cast<float>()
                                 .eval());
  program.set("lens", lensOf(view.camera));
}

void PicturePass::run(const gl::Texture& picture, const gl::Texture& depth, const View& view,
                      gl::Framebuffer& target) {
  program_.setTexture("picture", 0, picture);
  if (readsDepth()) setDepthInputs(program_, depth, view);
  gl::drawFullScreen(program_, target);
}

Result<gl::Program> makeDepthReader(gl::Context& context) {
  const std::array<ShaderFile, 2> files{kDepth, {"depth_read.frag", text::depth_read_frag}};
  return gl::Program::fullScreen(context, files);
}

Result<std::vector<std::unique_ptr<PicturePass>>> makePasses(const PassContext& context,
                                                             const std::vector<EffectSettings>& effects) {
  std::vector<std::unique_ptr<PicturePass>> passes;
  std::optional<Error> error;
  // Compiles the files as one pass and hands the program on; nothing for effects that are not named.
  const auto add = [&](Effect effect, std::initializer_list<ShaderFile> files, const auto& make) {
    const EffectSettings* settings = findEffect(effects, effect);
    if (!settings || error) return;
    Result<gl::Program> program = gl::Program::fullScreen(context.gl, std::span(files.begin(), files.size()));
    if (!program) {
      error = program.error();
      return;
    }
    passes.push_back(make(std::move(*program), *settings));
  };
  const auto plain = [](auto type) {
    return [](gl::Program program, const EffectSettings& settings) -> std::unique_ptr<PicturePass> {
      return std::make_unique<typename decltype(type)::type>(std::move(program), settings);
    };
  };
  const auto with = [](auto type, const auto& extra) {
    return [&extra](gl::Program program, const EffectSettings& settings) -> std::unique_ptr<PicturePass> {
      return std::make_unique<typename decltype(type)::type>(std::move(program), settings, extra);
    };
  };
  add(Effect::CloudShadows, {kNoise, kPass, kDepth, {"clouds.frag", text::clouds_frag}},
      with(std::type_identity<CloudPass>{}, context.world.towards_sun));
  add(Effect::Haze, {kPass, kDepth, {"haze.frag", text::haze_frag}}, plain(std::type_identity<HazePass>{}));
  add(Effect::Defocus, {kPass, kDepth, {"defocus.frag", text::defocus_frag}},
      plain(std::type_identity<DefocusPass>{}));
  add(Effect::MotionBlur, {kPass, kDepth, {"motion_blur.frag", text::motion_blur_frag}},
      plain(std::type_identity<MotionBlurPass>{}));
  add(Effect::LensDistortion, {kPass, {"lens.frag", text::lens_frag}},
      with(std::type_identity<LensPass>{}, context.sensor));
  add(Effect::Vignetting, {kPass, {"vignetting.frag", text::vignetting_frag}},
      with(std::type_identity<VignettingPass>{}, context.sensor));
  add(Effect::ExposureDrift, {kPass, {"exposure.frag", text::exposure_frag}},
      with(std::type_identity<ExposurePass>{}, context.path));
  add(Effect::SensorNoise, {kNoise, kPass, {"sensor_noise.frag", text::sensor_noise_frag}},
      plain(std::type_identity<NoisePass>{}));
  if (error) return tl::unexpected<Error>(*error);
  return passes;
}

}  // namespace overfly::scene
