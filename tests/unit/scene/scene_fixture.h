#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "render/gl/context.h"
#include "render/scene/renderer.h"

namespace overfly::scene {

// Lines that begin with "base =" may stand anywhere: they are the root's.
inline std::shared_ptr<const World> worldOf(std::string toml) {
  for (std::size_t at = 0; (at = toml.find("\nbase =", at)) != std::string::npos;) {
    const std::size_t end = toml.find('\n', at + 1);
    const std::string line = toml.substr(at + 1, end - at);
    toml.erase(at + 1, line.size());
    toml = line + toml;
    at = line.size() + at;
  }
  const Result<SceneDescription> scene =
      parseScene(toml + "[place]\nlat_deg = 47\nlon_deg = 9\nheight_m = 500\n", "test.toml");
  if (!scene) throw std::runtime_error(scene.error().message);
  return *buildWorld(*scene);
}

// A world with a renderer on a context of its own.
struct Stage {
  explicit Stage(const std::string& toml) : Stage(worldOf(toml)) {}
  explicit Stage(std::shared_ptr<const World> made) : world(std::move(made)) {
    Result<gl::Context> created = gl::Context::create();
    if (!created) throw std::runtime_error(created.error().message);
    context = std::make_unique<gl::Context>(std::move(*created));
    Result<std::unique_ptr<Renderer>> made_renderer = Renderer::create(*context, world);
    if (!made_renderer) throw std::runtime_error(made_renderer.error().message);
    renderer = std::move(*made_renderer);
  }
  Picture render(int frame = 0) {
    Result<Picture> picture = renderer->render(frame);
    if (!picture) throw std::runtime_error(picture.error().message);
    EXPECT_TRUE(context->takeErrors().empty());
    return std::move(*picture);
  }
  Picture render(const CameraState& state, const CameraMotion& motion = {}, double time_s = 0,
                 int frame = 0) {
    Result<Picture> picture = renderer->render(state, motion, time_s, frame);
    if (!picture) throw std::runtime_error(picture.error().message);
    return std::move(*picture);
  }

  std::shared_ptr<const World> world;
  std::unique_ptr<gl::Context> context;
  std::unique_ptr<Renderer> renderer;
};

inline int at(const Picture& picture, int x, int y, int channel) {
  return picture.rgb[static_cast<std::size_t>(3 * (y * picture.width + x) + channel)];
}

// Linear light of a pixel: the simulated response is a square root.
inline double linearAt(const Picture& picture, int x, int y, int channel = 1) {
  const double encoded = at(picture, x, y, channel) / 255.0;
  return encoded * encoded;
}

// Straight down from a place, the picture's top to the north.
inline CameraState lookingDown(double east, double north, double height) {
  CameraState state;
  state.position = {east, north, height};
  state.enu_from_camera =
      Eigen::Quaterniond(Eigen::AngleAxisd(3.14159265358979323846, Eigen::Vector3d::UnitX()));
  return state;
}

// Share of pixels whose every channel differs by at most `most`.
inline double agreement(const Picture& a, const Picture& b, int most) {
  EXPECT_EQ(a.rgb.size(), b.rgb.size());
  std::size_t good = 0;
  for (std::size_t i = 0; i < a.rgb.size(); i += 3) {
    int worst = 0;
    for (std::size_t c = 0; c < 3; ++c)
      worst = std::max(worst, std::abs(int{a.rgb[i + c]} - int{b.rgb[i + c]}));
    good += worst <= most ? 1 : 0;
  }
  return 3.0 * static_cast<double>(good) / static_cast<double>(a.rgb.size());
}

inline const std::string kSmallCamera = "[camera]\nwidth = 320\nheight = 240\nfx = 240\n";

}  // namespace overfly::scene
