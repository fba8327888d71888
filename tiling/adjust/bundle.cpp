#include "tiling/adjust/bundle.h"

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <chrono>
#include <cmath>

#include "tiling/adjust/detail/reduced_normal.h"
#include "tiling/adjust/detail/residuals.h"

namespace overfly::tiling::adjust {
namespace {

using Vector8 = Eigen::Matrix<double, Lens::kSize, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

Eigen::Matrix3d sqrtInformation(const Eigen::Matrix3d& covariance) {
  const Eigen::Matrix3d information = covariance.inverse();
  return information.llt().matrixU();
}

// Which entries of a shared block stay: those whose prior sigma is zero, or all.
template <int N>
void addSharedBlock(ceres::Problem& problem, Eigen::Matrix<double, N, 1>& value,
                    const Eigen::Matrix<double, N, 1>& centre, const Eigen::Matrix<double, N, 1>& sigma,
                    bool free) {
  problem.AddParameterBlock(value.data(), N);
  std::vector<int> held;
  detail::BlockPrior<N> prior{centre, Eigen::Matrix<double, N, 1>::Zero()};
  for (int i = 0; i < N; ++i) {
    if (sigma[i] > 0)
      prior.inverse_sigma[i] = 1 / sigma[i];
    else
      held.push_back(i);
  }
  if (!free || held.size() == N) {
    problem.SetParameterBlockConstant(value.data());
    return;
  }
  if (!held.empty()) problem.SetManifold(value.data(), new ceres::SubsetManifold(N, held));
  problem.AddResidualBlock(
      new ceres::AutoDiffCostFunction<detail::BlockPrior<N>, N, N>(new detail::BlockPrior<N>(prior)), nullptr,
      value.data());
}

struct Blocks {
  std::vector<std::array<double, 7>> poses;  // position, quaternion x y z w
  Eigen::Matrix<double, 1, 1> delay;
};

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

class BreakOff : public ceres::IterationCallback {
 public:
  explicit BreakOff(std::stop_token stop) : stop_(std::move(stop)) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
    return stop_.stop_requested() ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }

 private:
  std::stop_token stop_;
};

}  // namespace

Vector8 Lens::parameters() const {
  Vector8 p = Vector8::Zero();
  p.head<3>() << model.fx, model.cx, model.cy;
  for (std::size_t i = 0; i < std::min<std::size_t>(5, model.distortion.size()); ++i)
    p[static_cast<int>(3 + i)] = model.distortion[i];
  return p;
}

capture::CameraModel Lens::with(const Vector8& parameters) const {
  capture::CameraModel out = model;
  out.fx = parameters[0];
  out.fy = parameters[0] * model.fy / model.fx;
  out.cx = parameters[1];
  out.cy = parameters[2];
  if (out.kind == capture::CameraModel::Kind::Fisheye) {
    out.distortion.assign(parameters.data() + 3, parameters.data() + 7);
    return out;
  }
  if (out.kind == capture::CameraModel::Kind::Pinhole && parameters.tail<5>().isZero()) return out;
  out.kind = capture::CameraModel::Kind::RadialTangential;
  if (out.distortion.size() < 4) out.distortion.resize(4, 0);
  if (out.distortion.size() == 4 && parameters[7] != 0) out.distortion.resize(5, 0);
  for (std::size_t i = 0; i < std::min<std::size_t>(5, out.distortion.size()); ++i)
    out.distortion[i] = parameters[static_cast<int>(3 + i)];
  return out;
}

std::optional<Eigen::Vector2d> projectWith(const Lens& lens, const Vector8& parameters,
                                           const Eigen::Vector3d& point_in_camera) {
  Eigen::Vector2d px;
  if (!detail::project(detail::LensForm(lens.model), parameters.data(), point_in_camera, px))
    return std::nullopt;
  return px;
}

std::optional<Eigen::Vector2d> reprojectionResidual(const Bundle& bundle, const BundleObservation& o) {
  const auto& frame = bundle.frames[static_cast<std::size_t>(o.frame)];
  const auto px = projectWith(bundle.lens, bundle.shared.lens,
                              frame.enu_from_camera.conjugate() *
                                  (bundle.points[static_cast<std::size_t>(o.point)] - frame.position));
  if (!px) return std::nullopt;
  return *px - o.pixel;
}

Eigen::Vector3d rotationVector(const Eigen::Quaterniond& q) {
  const Eigen::AngleAxisd a(q.w() < 0 ? Eigen::Quaterniond(-q.coeffs()) : q);
  return a.angle() * a.axis();
}

Eigen::Quaterniond fromRotationVector(const Eigen::Vector3d& v) {
  const double angle = v.norm();
  if (angle < 1e-300) return Eigen::Quaterniond::Identity();
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, v / angle));
}

SolveReport solve(Bundle& bundle, const SolveOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  SolveReport report;
  ceres::Problem problem;
  std::vector<std::array<double, 7>> poses(bundle.frames.size());
  Eigen::Matrix<double, 1, 1> delay(bundle.shared.delay_s);
  auto& shared = bundle.shared;
  const auto& sigmas = bundle.prior_sigmas;
  const bool free = options.free_shared;
  addSharedBlock<Lens::kSize>(problem, shared.lens, bundle.prior.lens, sigmas.lens, free);
  addSharedBlock<3>(problem, shared.boresight, bundle.prior.boresight, sigmas.boresight, free);
  addSharedBlock<3>(problem, shared.lever_m, bundle.prior.lever_m, sigmas.lever_m, free);
  addSharedBlock<3>(problem, shared.offset_m, bundle.prior.offset_m, sigmas.offset_m, free);
  addSharedBlock<1>(problem, delay, Eigen::Matrix<double, 1, 1>(bundle.prior.delay_s),
                    Eigen::Matrix<double, 1, 1>(sigmas.delay_s), free);

  const detail::LensForm form(bundle.lens.model);
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  std::vector<double*> kept;  // parameter blocks in the reduced system: poses first, then shared
  std::vector<int> frame_column(bundle.frames.size(), -1);
  int column = 0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    auto& frame = bundle.frames[i];
    frame.enu_from_camera.normalize();
    std::copy_n(frame.position.data(), 3, poses[i].data());
    std::copy_n(frame.enu_from_camera.coeffs().data(), 4, poses[i].data() + 3);
    double *position = poses[i].data(), *rotation = poses[i].data() + 3;
    problem.AddParameterBlock(position, 3);
    problem.AddParameterBlock(rotation, 4, new ceres::EigenQuaternionManifold);
    if (frame.fixed) {
      problem.SetParameterBlockConstant(position);
      problem.SetParameterBlockConstant(rotation);
      continue;  // its telemetry was used when it was adjusted
    }
    frame_column[i] = column;
    column += 6;
    kept.push_back(position);
    kept.push_back(rotation);
    if (frame.hold) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<detail::HeldPosition, 3, 3>(
              new detail::HeldPosition{frame.position, sqrtInformation(frame.hold->position_covariance)}),
          nullptr, position);
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<detail::HeldAttitude, 3, 4>(new detail::HeldAttitude{
              frame.enu_from_camera, sqrtInformation(frame.hold->attitude_covariance)}),
          nullptr, rotation);
    }
    if (frame.has_position_prior)
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<detail::PositionPrior, 3, 3, 4, 3, 3, 1>(new detail::PositionPrior{
              frame.prior_position, frame.displacement, frame.velocity, bundle.shared.delay_s,
              sqrtInformation(frame.prior_position_covariance)}),
          new ceres::CauchyLoss(options.prior_loss), position, rotation, shared.lever_m.data(),
          shared.offset_m.data(), delay.data());
    if (frame.has_attitude_prior)
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<detail::AttitudePrior, 3, 4, 3>(new detail::AttitudePrior{
              frame.prior_enu_from_camera, frame.turn, sqrtInformation(frame.prior_attitude_covariance)}),
          new ceres::CauchyLoss(options.prior_loss), rotation, shared.boresight.data());
  }
  std::vector<int> seen(bundle.points.size(), 0);
  for (const auto& o : bundle.observations) {
    auto& pose = poses[static_cast<std::size_t>(o.frame)];
    double* point = bundle.points[static_cast<std::size_t>(o.point)].data();
    seen[static_cast<std::size_t>(o.point)]++;
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<detail::Reprojection, 2, 3, 4, 3, Lens::kSize>(
            new detail::Reprojection{form, o.pixel, 1 / (o.sigma_px > 0 ? o.sigma_px : options.sigma_px)}),
        new ceres::CauchyLoss(options.loss_px), pose.data(), pose.data() + 3, point, shared.lens.data());
  }
  for (const auto& c : bundle.control) {
    double* point = bundle.points[static_cast<std::size_t>(c.point)].data();
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<detail::BlockPrior<3>, 3, 3>(
                                 new detail::BlockPrior<3>{c.position, c.sigma_m.cwiseInverse()}),
                             nullptr, point);
  }
  std::vector<double*> point_blocks;
  for (std::size_t i = 0; i < seen.size(); ++i)
    if (seen[i] > 0) point_blocks.push_back(bundle.points[i].data());
  for (double* block : point_blocks) ordering->AddElementToGroup(block, 0);
  std::vector<double*> all;
  problem.GetParameterBlocks(&all);
  for (double* block : all)
    if (!ordering->IsMember(block)) ordering->AddElementToGroup(block, 1);

  ceres::Solver::Options solver;
  solver.linear_solver_type = kept.size() < 2 * 60 ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
  solver.linear_solver_ordering = ordering;
  solver.max_num_iterations = options.max_iterations;
  solver.num_threads = options.threads;
  solver.function_tolerance = 1e-5;
  solver.logging_type = ceres::SILENT;
  BreakOff break_off(options.stop);
  solver.callbacks.push_back(&break_off);
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  report.usable = summary.IsSolutionUsable();
  report.message = summary.message;
  report.iterations = static_cast<int>(summary.iterations.size());
  if (!report.usable) return report;

  for (std::size_t i = 0; i < poses.size(); ++i) {
    std::copy_n(poses[i].data(), 3, bundle.frames[i].position.data());
    std::copy_n(poses[i].data() + 3, 4, bundle.frames[i].enu_from_camera.coeffs().data());
    bundle.frames[i].enu_from_camera.normalize();
  }
  shared.delay_s = delay[0];

  std::vector<double> sizes;
  double sum2 = 0;
  for (const auto& o : bundle.observations)
    if (const auto r = reprojectionResidual(bundle, o)) {
      sizes.push_back(r->norm() / (o.sigma_px > 0 ? o.sigma_px : options.sigma_px));
      sum2 += r->squaredNorm();
    }
  if (!sizes.empty()) {
    report.rms_px = std::sqrt(sum2 / static_cast<double>(sizes.size()));
    // |r| of a two-dimensional normal has the median 1.1774 sigma; freedom lost to points and poses.
    const double unknowns = 3.0 * static_cast<double>(point_blocks.size()) + column;
    const double measured = 2.0 * static_cast<double>(sizes.size());
    const double freedom = std::max(0.1, 1 - unknowns / measured);
    report.sigma0 = median(sizes) / 1.1774 / std::sqrt(freedom);
  }

  if (options.covariance) {
    struct SharedRange {
      double* block;
      int first = 0, size = 0;
    };
    std::vector<SharedRange> ranges;
    for (double* block : {shared.lens.data(), shared.boresight.data(), shared.lever_m.data(),
                          shared.offset_m.data(), delay.data()}) {
      const bool constant = problem.IsParameterBlockConstant(block);
      ranges.push_back({block, column, constant ? 0 : problem.ParameterBlockTangentSize(block)});
      if (constant) continue;
      kept.push_back(block);
      column += ranges.back().size;
    }
    std::vector<int> measured;  // how often each of the points was
    for (const int n : seen)
      if (n > 0) measured.push_back(n);
    const detail::QuadraticHeights dome =
        options.dome ? detail::quadraticHeights(point_blocks, measured) : detail::QuadraticHeights{};
    const detail::ReducedNormal normal(problem, kept, point_blocks, dome.weights, options.threads);
    report.usable = normal.good();
    if (!normal.good()) report.message = "the normal equations are singular";
    const double scale = std::max(1.0, report.sigma0 * report.sigma0);
    report.frame_covariances.assign(poses.size(), Matrix6::Zero());
    for (std::size_t i = 0; i < poses.size(); ++i) {
      if (frame_column[i] < 0) continue;
      Matrix6 c = normal.inverseBlock(frame_column[i], 6);
      c.bottomRows<3>() *= 2;  // the manifold's tangent is half the rotation vector
      c.rightCols<3>() *= 2;
      report.frame_covariances[i] = c * scale;
    }
    const auto fill = [&](const SharedRange& range, const auto& prior, auto& out) {
      const Eigen::MatrixXd c = normal.inverseBlock(range.first, range.size);
      for (int i = 0, at = 0; i < out.size() && range.size > 0; ++i)
        if (prior[i] > 0) {
          out[i] = std::sqrt(std::max(0.0, c(at, at) * scale));
          out[i] = std::min<double>(out[i], prior[i]);
          ++at;
        }
    };
    auto& s = report.shared_sigmas;
    Eigen::Matrix<double, 1, 1> delay_sigma(0.0);
    fill(ranges[0], sigmas.lens, s.lens);
    fill(ranges[1], sigmas.boresight, s.boresight);
    fill(ranges[2], sigmas.lever_m, s.lever_m);
    fill(ranges[3], sigmas.offset_m, s.offset_m);
    fill(ranges[4], Eigen::Matrix<double, 1, 1>(sigmas.delay_s), delay_sigma);
    s.delay_s = delay_sigma[0];
    if (dome.weights.rows() > 0) {
      report.dome.covariance = normal.heightsCovariance() * scale;
      report.dome.sigma_m = std::sqrt((dome.spread * report.dome.covariance).trace());
    }
  }
  report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return report;
}

}  // namespace overfly::tiling::adjust
