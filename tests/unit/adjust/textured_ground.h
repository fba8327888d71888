#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "capture/frame.h"
#include "capture/geo/footprint.h"
#include "capture/geo/geodetic.h"

// Pictures of an uneven ground with a random texture, as small frames with real features: quick, with exact
// poses.
namespace overfly::tests {

class TexturedGround {
 public:
  explicit TexturedGround(std::uint32_t seed = 1) : random_(seed), local_(geo::Geodetic{0.8, 0.2, 400}) {
    for (std::size_t octave = 0; octave < kOctaves; ++octave) {
      noise_[octave].resize(kNoise * kNoise);
      for (auto& v : noise_[octave]) v = std::uniform_real_distribution<float>(-1, 1)(random_);
    }
    camera.kind = capture::CameraModel::Kind::RadialTangential;
    camera.width = 480;
    camera.height = 360;
    camera.fx = camera.fy = 400;
    camera.cx = 240;
    camera.cy = 180;
    camera.distortion = {0, 0, 0, 0};
  }

  capture::CameraModel camera;
  [[nodiscard]] const geo::LocalFrame& local() const { return local_; }

  struct Truth {
    Eigen::Vector3d position;
    Eigen::Quaterniond enu_from_camera;
  };
  // Frame i of legs of ten frames, 40 m high, 8 m and 20 m apart.
  [[nodiscard]] static Truth at(int i) {
    const int leg = i / 10, along = leg % 2 == 0 ? i % 10 : 9 - i % 10;
    return {{8.0 * along, 20.0 * leg, 40 + 0.5 * std::sin(0.7 * i)},
            geo::enuFromCamera(leg % 2 == 0 ? 1.57 : -1.57, -1.5708 + 0.03 * std::sin(1.1 * i),
                               0.03 * std::cos(0.9 * i))};
  }

  // The frame as a camera with a receiver of `noise_m` and an attitude of `noise_rad` would give it.
  [[nodiscard]] capture::FramePtr frame(int i, double noise_m, double noise_rad) {
    const Truth truth = at(i);
    auto out = std::make_shared<capture::Frame>();
    out->sequence = static_cast<std::uint64_t>(i);
    out->name = std::to_string(i);
    out->camera_id = "cam";
    out->time_ns = std::int64_t{2'000'000'000} * (i + 1);
    out->camera = camera;
    out->image = picture(truth);
    std::normal_distribution<double> normal;
    const auto noise = [&] { return Eigen::Vector3d(normal(random_), normal(random_), normal(random_)); };
    capture::Pose pose;
    pose.time_ns = out->time_ns;
    pose.position_in_ecef = local_.ecefFromEnu(truth.position + noise_m * noise());
    const Eigen::Vector3d turn = noise_rad * noise();
    const Eigen::Quaterniond turned =
        Eigen::Quaterniond(Eigen::AngleAxisd(turn.norm(), turn.normalized())) * truth.enu_from_camera;
    pose.ecef_from_camera = Eigen::Quaterniond(local_.enuFromEcefRotation().transpose()) * turned;
    pose.covariance.diagonal() << noise_m * noise_m, noise_m * noise_m, noise_m * noise_m,
        noise_rad * noise_rad, noise_rad * noise_rad, noise_rad * noise_rad;
    out->pose = pose;
    return out;
  }

  [[nodiscard]] Eigen::Vector3d positionOf(const capture::Pose& pose) const {
    return local_.enuFromEcef(pose.position_in_ecef);
  }

  bool featureless = false;  // water: no texture at all
  bool rows = false;         // a ploughed field: texture changes across the rows alone
  double repeats_m = 0;      // a facade: the texture comes again after this, metres; 0: never

 private:
  static constexpr std::size_t kOctaves = 4;
  static constexpr int kNoise = 256;

  [[nodiscard]] static double heightAt(double x, double y) { return 1.5 * std::sin(x / 9) * std::cos(y / 7); }

  [[nodiscard]] float textureAt(double x, double y) const {
    if (featureless) return 0;
    if (rows) y = 0;
    if (repeats_m > 0) {
      x -= repeats_m * std::floor(x / repeats_m);
      y -= repeats_m * std::floor(y / repeats_m);
    }
    float sum = 0;
    double size = 4;
    for (std::size_t octave = 0; octave < kOctaves; ++octave, size /= 2.2) {
      const double u = x / size, v = y / size;
      const auto iu = static_cast<std::int64_t>(std::floor(u)), iv = static_cast<std::int64_t>(std::floor(v));
      const auto fu = static_cast<float>(u - std::floor(u)), fv = static_cast<float>(v - std::floor(v));
      const auto n = [&](std::int64_t a, std::int64_t b) {
        const auto wrap = [](std::int64_t k) {
          return static_cast<std::size_t>(((k % kNoise) + kNoise) % kNoise);
        };
        return noise_[octave][wrap(b) * kNoise + wrap(a)];
      };
      sum += (1 - fu) * ((1 - fv) * n(iu, iv) + fv * n(iu, iv + 1)) +
             fu * ((1 - fv) * n(iu + 1, iv) + fv * n(iu + 1, iv + 1));
    }
    return sum;
  }

  [[nodiscard]] capture::Image picture(const Truth& truth) const {
    capture::Image image;
    image.format = capture::PixelFormat::Grey8;
    image.width = image.stride = camera.width;
    image.height = camera.height;
    image.bytes.resize(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x) {
        const Eigen::Vector3d ray =
            truth.enu_from_camera *
            Eigen::Vector3d((x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1);
        Eigen::Vector3d ground = truth.position;
        double height = 0;
        for (int k = 0; k < 3; ++k) {  // gentle relief: converges at once
          ground = truth.position + ray * ((height - truth.position.z()) / ray.z());
          height = heightAt(ground.x(), ground.y());
        }
        image.bytes[static_cast<std::size_t>(y * camera.width + x)] =
            static_cast<std::uint8_t>(std::clamp(128 + 50 * textureAt(ground.x(), ground.y()), 0.0f, 255.0f));
      }
    return image;
  }

  std::mt19937 random_;
  geo::LocalFrame local_;
  std::vector<float> noise_[kOctaves];
};

}  // namespace overfly::tests
