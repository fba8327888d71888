#pragma once
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include "capture/camera_model.h"
#include "capture/geo/footprint.h"
#include "tiling/adjust/pose_map.h"

// A flight simulated as two-dimensional tracks: true poses and points, pixels with noise and wrong matches,
// telemetry with every error that the adjustment knows. No images, so that truth is exact and it is quick.
namespace overfly::tests {

using tiling::adjust::FrameId;
using tiling::adjust::Match;
using tiling::adjust::MatchGuide;

struct SimulatedSettings {
  int legs = 4;
  int frames_per_leg = 10;
  double height_m = 80, relief_m = 4, spacing_m = 35, speed_mps = 9, interval_s = 2;
  double wobble = 0.05;        // true attitude change, radians (with wind, one-sided)
  int points_per_frame = 500;  // about
  double pixel_noise = 0.5;
  double wrong_matches = 0.03;
  // What is wrong with the telemetry and the nominal lens.
  double gnss_noise_m = 0, attitude_noise = 0, delay_s = 0;
  double horizon_drift = 0;  // radians of pitch just after a turn, settling over 15 s
  Eigen::Vector3d boresight = Eigen::Vector3d::Zero(), lever_m = Eigen::Vector3d::Zero();
  double focal_error = 0;  // relative
  bool distorted = false;
  std::uint32_t seed = 1;
};

class SimulatedTracks {
 public:
  explicit SimulatedTracks(const SimulatedSettings& settings) : settings_(settings), random_(settings.seed) {
    camera.kind = capture::CameraModel::Kind::RadialTangential;
    camera.width = 1600;
    camera.height = 1200;
    camera.fx = camera.fy = 1200;
    camera.cx = 800;
    camera.cy = 600;
    camera.distortion = {0, 0, 0, 0};
    nominal = camera;
    nominal.fx = nominal.fy = camera.fx * (1 + settings.focal_error);
    if (settings.distorted) {
      camera.cx = 812;
      camera.cy = 592;
      camera.distortion = {-0.05, 0.02, 0.001, -0.0008};
    }
    const double leg = settings.frames_per_leg * settings.speed_mps * settings.interval_s;
    const double depth = settings.legs * settings.spacing_m;
    const double area = (leg + 160) * (depth + 160);
    const double seen = (settings.height_m * 4 / 3) * settings.height_m;
    const int count = static_cast<int>(settings.points_per_frame * area / seen);
    std::uniform_real_distribution<double> x(-80, leg + 80), y(-80, depth + 80);
    for (int i = 0; i < count; ++i) {
      Eigen::Vector3d p(x(random_), y(random_), 0);
      p.z() = ground(p.x(), p.y());
      index(p, static_cast<int>(points_.size()));
      points_.push_back(p);
    }
  }

  [[nodiscard]] int frames() const { return settings_.legs * settings_.frames_per_leg; }
  [[nodiscard]] double time(int i) const { return i * settings_.interval_s; }

  struct Truth {
    Eigen::Vector3d position;
    Eigen::Quaterniond enu_from_camera;
  };
  // Legs joined by half circles, as a function of time, so that a delay means something.
  [[nodiscard]] Truth at(double t) const {
    const double leg = settings_.frames_per_leg * settings_.speed_mps * settings_.interval_s;
    const double s = settings_.speed_mps * t;
    const int n = static_cast<int>(std::floor(s / leg));
    const double along = s - n * leg, turn = 0.2 * leg;  // the last part of a leg goes over to the next
    double x = along, heading = M_PI / 2, y = n * settings_.spacing_m;
    if (along > leg - turn) {
      const double u = (along - (leg - turn)) / turn;
      y += settings_.spacing_m * u * u * (3 - 2 * u);
      x = leg - turn + turn / M_PI * std::sin(M_PI * u);
      heading -= M_PI * u * u * (3 - 2 * u);
    }
    if (n % 2 != 0) {
      x = leg - turn - x;
      heading = -heading;
    }
    if (straight) x = s, y = 0, heading = M_PI / 2;
    if (turning_only) x = 40, y = 40;
    const double w = settings_.wobble;
    const double roll = w * (0.6 + std::sin(0.9 * t)), pitch = w * (0.4 + std::sin(1.3 * t + 1));
    const double z = settings_.height_m + 1.5 * std::sin(0.11 * t);
    return {{x, y, z}, geo::enuFromCamera(heading + 0.1 * std::sin(0.05 * t), pitch - M_PI / 2, roll)};
  }
  bool straight = false;      // one leg without end
  bool turning_only = false;  // hovers, only the attitude changes

  // The telemetry of frame i as a device would report it.
  [[nodiscard]] tiling::adjust::PriorPose telemetry(int i) {
    std::normal_distribution<double> normal;
    const auto noise = [&] { return Eigen::Vector3d(normal(random_), normal(random_), normal(random_)); };
    const Truth then = at(time(i) - settings_.delay_s);
    tiling::adjust::PriorPose prior;
    prior.time_ns = static_cast<std::int64_t>(std::llround(time(i) * 1e9));
    prior.position =
        then.position + then.enu_from_camera * settings_.lever_m + settings_.gnss_noise_m * noise();
    const double leg_s = settings_.frames_per_leg * settings_.interval_s;
    const double drift = settings_.horizon_drift * std::exp(-std::fmod(time(i), leg_s) / 15);
    prior.enu_from_camera =
        tiling::adjust::fromRotationVector(settings_.attitude_noise * noise()) * then.enu_from_camera *
        tiling::adjust::fromRotationVector(Eigen::Vector3d(drift, 0, 0) - settings_.boresight);
    const double p = std::max(settings_.gnss_noise_m, 0.05);
    const double a = std::max({settings_.attitude_noise, settings_.horizon_drift, 0.005});
    prior.covariance.setZero();
    prior.covariance.diagonal() << p * p, p * p, p * p, a * a, a * a, a * a;
    return prior;
  }

  struct Picture {
    std::vector<Eigen::Vector2d> pixels;
    std::vector<int> ids;  // point of each keypoint
  };
  [[nodiscard]] Picture take(int i) { return take(at(time(i))); }
  [[nodiscard]] Picture take(const Truth& truth) {
    Picture out;
    std::normal_distribution<double> normal(0, settings_.pixel_noise);
    const double reach = 1.2 * truth.position.z();
    for (double x = truth.position.x() - reach; x < truth.position.x() + reach + kCell; x += kCell)
      for (double y = truth.position.y() - reach; y < truth.position.y() + reach + kCell; y += kCell) {
        const auto cell = cells_.find(key(x, y));
        if (cell == cells_.end()) continue;
        for (const int p : cell->second) {
          const Eigen::Vector3d in_camera =
              truth.enu_from_camera.conjugate() * (points_[static_cast<std::size_t>(p)] - truth.position);
          const auto px = camera.project(in_camera);
          if (!px || px->x() < 0 || px->y() < 0 || px->x() > camera.width || px->y() > camera.height)
            continue;
          out.pixels.emplace_back(px->x() + normal(random_), px->y() + normal(random_));
          out.ids.push_back(p);
        }
      }
    return out;
  }

  capture::CameraModel camera, nominal;  // true and assumed

  [[nodiscard]] static double ground(double x, double y, double relief) {
    return relief * (std::sin(x / 37) + std::cos(y / 23)) +
           (std::fmod(std::abs(x), 50) < 8 && std::fmod(std::abs(y), 40) < 8 ? 2 * relief : 0);
  }

 private:
  static constexpr double kCell = 10;
  [[nodiscard]] double ground(double x, double y) const { return ground(x, y, settings_.relief_m); }
  [[nodiscard]] static std::pair<int, int> key(double x, double y) {
    return {static_cast<int>(std::floor(x / kCell)), static_cast<int>(std::floor(y / kCell))};
  }
  void index(const Eigen::Vector3d& p, int i) { cells_[key(p.x(), p.y())].push_back(i); }

  SimulatedSettings settings_;
  std::mt19937 random_;
  std::vector<Eigen::Vector3d> points_;
  std::map<std::pair<int, int>, std::vector<int>> cells_;
};

// Matches by the points' identity, some of them wrong; obeys a guide as an image matcher does.
class TruthMatcher : public tiling::adjust::Matcher {
 public:
  explicit TruthMatcher(double wrong, std::uint32_t seed = 7) : wrong_(wrong), random_(seed) {}
  void add(FrameId id, SimulatedTracks::Picture picture) { pictures_[id] = std::move(picture); }
  std::vector<Match> match(FrameId a, FrameId b, const MatchGuide* guide) override {
    const auto &pa = pictures_.at(a), &pb = pictures_.at(b);
    std::map<int, int> in_b;
    for (std::size_t i = 0; i < pb.ids.size(); ++i) in_b[pb.ids[i]] = static_cast<int>(i);
    std::vector<Match> out;
    std::uniform_real_distribution<double> uniform;
    for (std::size_t i = 0; i < pa.ids.size(); ++i) {
      const auto it = in_b.find(pa.ids[i]);
      if (it == in_b.end()) continue;
      int k = it->second;
      if (uniform(random_) < wrong_)
        k = static_cast<int>(uniform(random_) * static_cast<double>(pb.ids.size() - 1));
      if (guide != nullptr) {
        const auto at = guide->predict(static_cast<int>(i));
        if (!at || (pb.pixels[static_cast<std::size_t>(k)] - *at).norm() > guide->radius_px) continue;
      }
      out.push_back({static_cast<int>(i), k});
    }
    return out;
  }
  void forget(FrameId id) override { pictures_.erase(id); }

 private:
  double wrong_;
  std::mt19937 random_;
  std::map<FrameId, SimulatedTracks::Picture> pictures_;
};

}  // namespace overfly::tests
