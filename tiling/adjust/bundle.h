#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "capture/camera_model.h"

// The least-squares core of the pose adjustment: frames, points and what all frames share, in one local
// East-North-Up frame (metres). It knows no images and no flight order, so that it is tested on simulated
// tracks alone. Values only; nothing here is thread-bound.
namespace overfly::tiling::adjust {

// The lens as it is adjusted: one focal length (fy/fx stays as given), principal point, and up to five
// distortion coefficients in the order of CameraModel::distortion.
struct Lens {
  static constexpr int kSize = 8;
  static constexpr std::array<const char*, kSize> kNames{"f", "cx", "cy", "d0", "d1", "d2", "d3", "d4"};
  capture::CameraModel model;  // the nominal lens: kind, image size, aspect, k4..k6 where present
  [[nodiscard]] Eigen::Matrix<double, kSize, 1> parameters() const;
  [[nodiscard]] capture::CameraModel with(const Eigen::Matrix<double, kSize, 1>& parameters) const;
};

// One frame: its pose, and what the autopilot claimed about it.
struct BundleFrame {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // camera centre, ENU, metres
  Eigen::Quaterniond enu_from_camera = Eigen::Quaterniond::Identity();
  bool fixed = false;  // held constant (an older frame whose window has closed)
  // Held to where it is, but not constant: an older frame by its own uncertainty.
  struct Hold {
    Eigen::Matrix3d position_covariance = Eigen::Matrix3d::Identity();  // m^2
    Eigen::Matrix3d attitude_covariance = Eigen::Matrix3d::Identity();  // rad^2, ENU side
  };
  std::optional<Hold> hold;

  // Telemetry of the frame. It is late by `SharedParameters::delay_s`: it is compared with where the track
  // was that long before, which is the frame's own pose moved by `displacement` and `turn` (at the delay that
  // the bundle came with) and, as the delay is adjusted, along `velocity`. Attitudes do not tell the delay:
  // between two frames a drone rocks in ways that their two attitudes do not show.
  Eigen::Vector3d displacement = Eigen::Vector3d::Zero();    // metres
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();        // m/s
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();  // on the ENU side
  bool has_position_prior = false;
  Eigen::Vector3d prior_position = Eigen::Vector3d::Zero();
  Eigen::Matrix3d prior_position_covariance = Eigen::Matrix3d::Identity();  // noise from frame to frame, m^2
  bool has_attitude_prior = false;
  Eigen::Quaterniond prior_enu_from_camera = Eigen::Quaterniond::Identity();
  Eigen::Matrix3d prior_attitude_covariance = Eigen::Matrix3d::Identity();  // rad^2, ENU side
};

struct BundleObservation {
  int frame = 0;
  int point = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // first pixel's centre at (0.5, 0.5)
  double sigma_px = 0;                              // 0: SolveOptions::sigma_px
};

// A point whose place is known (ground control).
struct ControlConstraint {
  int point = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Vector3d sigma_m = Eigen::Vector3d::Ones();
};

// What all frames have in common. `sigma` beside each value is its prior (before) or result (after).
struct SharedParameters {
  Eigen::Matrix<double, Lens::kSize, 1> lens = Eigen::Matrix<double, Lens::kSize, 1>::Zero();
  Eigen::Vector3d boresight = Eigen::Vector3d::Zero();  // camera = telemetry attitude * exp(boresight), rad
  Eigen::Vector3d lever_m = Eigen::Vector3d::Zero();    // antenna minus camera centre, camera axes
  Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();   // telemetry minus truth, ENU: common to the flight
  double delay_s = 0;  // the telemetry of time t was true at t - delay (late: positive)
};

struct SharedSigmas {
  // f and c: pixels; distortion: as is.
  Eigen::Matrix<double, Lens::kSize, 1> lens = Eigen::Matrix<double, Lens::kSize, 1>::Zero();
  Eigen::Vector3d boresight = Eigen::Vector3d::Zero();
  Eigen::Vector3d lever_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d offset_m = Eigen::Vector3d::Zero();
  double delay_s = 0;
};

struct Bundle {
  Lens lens;
  SharedParameters shared;
  SharedParameters prior;     // the centre of the priors on the shared parameters
  SharedSigmas prior_sigmas;  // a zero keeps that parameter as it is
  std::vector<BundleFrame> frames;
  std::vector<Eigen::Vector3d> points;
  std::vector<BundleObservation> observations;
  std::vector<ControlConstraint> control;
};

struct SolveOptions {
  double sigma_px = 0.7;    // noise of an image measurement
  double loss_px = 2.0;     // residuals beyond this (in sigmas) lose weight: Cauchy
  double prior_loss = 3.0;  // the same for positions and attitudes, in their sigmas
  int max_iterations = 30;
  int threads = 1;
  std::stop_token stop;     // breaks off between iterations; the report is then not usable
  bool free_shared = true;  // false: lens, boresight, lever arm, offset and delay stay
  bool covariance = false;  // fill SolveReport's covariances (costs about as much as a solve)
  bool dome = false;        // with them SolveReport::dome
};

// How little the adjustment knows of a bend of the whole ground: of the quadratic surface that fits the
// points' heights best, which no shift, turn or scale takes away. All unknowns of poses, lens and points are
// in it.
struct DomeUncertainty {
  static constexpr double kUnit = 100;  // metres
  // Of its coefficients of x^2, xy, y^2: metres per kUnit^2, x east, y north.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  double sigma_m =
      0;  // 1 sigma of the surface less its plane: root mean square over the points; 0: not known
};

struct SolveReport {
  bool usable = false;
  std::string message;
  int iterations = 0;
  double seconds = 0;
  double rms_px = 0;  // root mean square length of the re-projection residuals
  double sigma0 = 1;  // a posteriori factor on sigma_px (robust)
  // 6x6 per frame: ENU position, then rotation vector on the ENU side; scaled by sigma0. Fixed frames: zero.
  std::vector<Eigen::Matrix<double, 6, 6>> frame_covariances;
  SharedSigmas shared_sigmas;  // of the adjusted values; zero where held
  DomeUncertainty dome;
};

// Adjusts `bundle` in place. Deterministic for threads = 1.
[[nodiscard]] SolveReport solve(Bundle& bundle, const SolveOptions& options);

// Re-projection residual in pixels (predicted minus measured); nullopt behind the camera.
[[nodiscard]] std::optional<Eigen::Vector2d> reprojectionResidual(const Bundle& bundle,
                                                                  const BundleObservation& observation);

// Projection through the adjusted lens parameters of a point given in camera axes; nullopt behind the camera.
[[nodiscard]] std::optional<Eigen::Vector2d> projectWith(
    const Lens& lens, const Eigen::Matrix<double, Lens::kSize, 1>& parameters,
    const Eigen::Vector3d& point_in_camera);

// Rotation vector of a unit quaternion and back.
[[nodiscard]] Eigen::Vector3d rotationVector(const Eigen::Quaterniond& q);
[[nodiscard]] Eigen::Quaterniond fromRotationVector(const Eigen::Vector3d& v);

}  // namespace overfly::tiling::adjust
