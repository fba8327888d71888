#include "render/scene/flight_plan.h"

#include <cmath>

#include "render/scene/gauss_markov.h"
#include "render/scene/random.h"

namespace overfly::scene {
namespace {

using Eigen::Vector3d;

// What the pose effects do to the states of a flight, frame by frame.
class PoseEffects {
 public:
  PoseEffects(const std::vector<EffectSettings>& effects, const std::vector<double>& times)
      : effects_(effects), times_(times) {
    if (const EffectSettings* gnss = find(Effect::GnssNoise)) {
      const double tau = (*gnss)["time_constant_s"];
      for (std::uint32_t axis = 0; axis < 3; ++axis) {
        wander_[axis] = gaussMarkov(hashOf(gnss->seed, axis), times,
                                    (*gnss)[axis == 2 ? "vertical_m" : "horizontal_m"], tau);
      }
      planJumps(*gnss);
    }
    if (const EffectSettings* attitude = find(Effect::AttitudeNoise)) {
      const double tau = (*attitude)["time_constant_s"];
      for (std::uint32_t axis = 0; axis < 3; ++axis) {
        turn_[axis] =
            gaussMarkov(hashOf(attitude->seed, axis), times,
                        geo::radians((*attitude)[axis == 2 ? "heading_drift_deg" : "drift_deg"]), tau);
      }
    }
  }

  [[nodiscard]] const EffectSettings* find(Effect effect) const { return findEffect(effects_, effect); }

  // The state that is recorded for frame `i`, from the exact state at the time that the record belongs to.
  [[nodiscard]] CameraState recorded(const FlightPath& path, std::size_t i) const {
    const EffectSettings* delay = find(Effect::TimeDelay);
    CameraState state = path.at(times_[i] - (delay ? (*delay)["delay_ms"] * 1e-3 : 0));
    if (const EffectSettings* mounting = find(Effect::Mounting)) {
      // Camera axes: forward is -y (the picture's top), right is x, down is z.
      const auto about = [&](const char* key, const Vector3d& axis) {
        return Eigen::Quaterniond(Eigen::AngleAxisd(geo::radians((*mounting)[key]), axis));
      };
      const Vector3d lever((*mounting)["right_m"], -(*mounting)["forward_m"], (*mounting)["down_m"]);
      state.position -= state.enu_from_camera * lever;
      state.enu_from_camera = state.enu_from_camera * about("yaw_deg", Vector3d::UnitZ()) *
                              about("pitch_deg", Vector3d::UnitX()) * about("roll_deg", -Vector3d::UnitY());
    }
    const auto number = static_cast<std::uint32_t>(i);
    if (const EffectSettings* gnss = find(Effect::GnssNoise)) {
      for (std::uint32_t axis = 0; axis < 3; ++axis) {
        state.position[axis] +=
            wander_[axis][i] + (*gnss)["white_m"] * normal(hashOf(gnss->seed, 10 + axis), number);
      }
      for (const Jump& jump : jumps_) {
        if (times_[i] >= jump.from_s && times_[i] < jump.until_s) state.position += jump.by;
      }
    }
    if (const EffectSettings* attitude = find(Effect::AttitudeNoise)) {
      Vector3d turn;
      for (std::uint32_t axis = 0; axis < 3; ++axis) {
        turn[axis] = turn_[axis][i] + geo::radians((*attitude)["white_deg"]) *
                                          normal(hashOf(attitude->seed, 10 + axis), number);
      }
      const double angle = turn.norm();
      if (angle > 0) state.enu_from_camera = Eigen::AngleAxisd(angle, turn / angle) * state.enu_from_camera;
    }
    return state;
  }

  // What a careful device would report of its own noise; systematic errors it does not know.
  [[nodiscard]] Eigen::Matrix<double, 6, 6> covariance() const {
    Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
    const auto squared = [](double v) { return v * v; };
    if (const EffectSettings* gnss = find(Effect::GnssNoise)) {
      const double white = squared((*gnss)["white_m"]);
      covariance(0, 0) = covariance(1, 1) = squared((*gnss)["horizontal_m"]) + white;
      covariance(2, 2) = squared((*gnss)["vertical_m"]) + white;
    }
    if (const EffectSettings* attitude = find(Effect::AttitudeNoise)) {
      const double white = squared(geo::radians((*attitude)["white_deg"]));
      covariance(3, 3) = covariance(4, 4) = squared(geo::radians((*attitude)["drift_deg"])) + white;
      covariance(5, 5) = squared(geo::radians((*attitude)["heading_drift_deg"])) + white;
    }
    return covariance;
  }

 private:
  struct Jump {
    double from_s, until_s;
    Vector3d by;
  };

  // Multipath: jumps begin as a Poisson process and last exponentially long.
  void planJumps(const EffectSettings& gnss) {
    const double rate = gnss["jumps_per_minute"] / 60;
    if (rate <= 0 || times_.empty()) return;
    double at = 0;
    for (std::uint32_t k = 0; at < times_.back(); ++k) {
      at -= std::log(1 - uniform(hashOf(gnss.seed, 20), k)) / rate;
      const double lasts = -std::log(1 - uniform(hashOf(gnss.seed, 21), k)) * gnss["jump_s"];
      Vector3d by;
      for (std::uint32_t axis = 0; axis < 3; ++axis)
        by[axis] = gnss["jump_m"] * normal(hashOf(gnss.seed, 22 + axis), k);
      jumps_.push_back({at, at + lasts, by});
    }
  }

  const std::vector<EffectSettings>& effects_;
  const std::vector<double>& times_;
  std::vector<double> wander_[3], turn_[3];
  std::vector<Jump> jumps_;
};

}  // namespace

FlightPlan planFlight(const World& world, const FlightPath& path) {
  const std::vector<EffectSettings>& effects = world.description.effects;
  std::vector<double> times;
  for (int frame = 0; frame < path.frames(); ++frame) times.push_back(path.timeOf(frame));
  const PoseEffects poses(effects, times);
  FlightPlan plan;
  for (const EffectSettings& settings : effects) {
    const Effect effect = settings.effect;
    plan.poses_are_exact = plan.poses_are_exact && effect != Effect::GnssNoise &&
                           effect != Effect::AttitudeNoise && effect != Effect::Mounting &&
                           effect != Effect::TimeDelay && effect != Effect::DroppedPoses;
  }
  const EffectSettings* dropped_poses = poses.find(Effect::DroppedPoses);
  const EffectSettings* stream = poses.find(Effect::DroppedFrames);
  for (std::size_t i = 0; i < times.size(); ++i) {
    const auto number = static_cast<std::uint32_t>(i);
    PlannedFrame frame;
    frame.frame = frame.picture = static_cast<int>(i);
    frame.time_s = times[i];
    frame.exact = poseOf(world.local, path.at(times[i]), 0);
    frame.recorded = plan.poses_are_exact ? frame.exact : poseOf(world.local, poses.recorded(path, i), 0);
    frame.recorded->covariance = poses.covariance();
    if (dropped_poses) {
      const double chance = uniform(dropped_poses->seed, number);
      const double dropped = (*dropped_poses)["dropped"];
      if (chance < dropped) {
        frame.recorded.reset();
      } else if (i > 0 && chance < dropped + (*dropped_poses)["late"]) {
        frame.recorded = poseOf(world.local, poses.recorded(path, i - 1), 0);
        frame.recorded->covariance = poses.covariance();
      }
    }
    if (stream) {
      if (uniform(hashOf(stream->seed, 1), number) < (*stream)["dropped"]) continue;
      if (i > 0 && uniform(hashOf(stream->seed, 2), number) < (*stream)["duplicated"])
        frame.picture = frame.frame - 1;
      if (uniform(hashOf(stream->seed, 3), number) < (*stream)["late"])
        frame.late_s = (*stream)["late_ms"] * 1e-3;
    }
    plan.frames.push_back(std::move(frame));
  }
  return plan;
}

}  // namespace overfly::scene
