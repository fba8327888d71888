#include <ceres/ceres.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>

#include "tiling/adjust/detail/residuals.h"
#include "tiling/adjust/pose_map.h"

// What the telemetry says of the track, and what is estimated about the telemetry: noise, delay, alignment.
namespace overfly::tiling::adjust {
namespace {

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Telemetry residuals of one frame under a similarity of the whole part: scale = exp(s), turn, shift.
struct SimilarityPosition {
  Eigen::Vector3d position, said;
  Eigen::Matrix3d sqrt_information;
  template <class T>
  bool operator()(const T* log_scale, const T* turn, const T* shift, T* residual) const {
    using std::exp;
    const T p[3] = {T(position[0]), T(position[1]), T(position[2])};
    T turned[3];
    ceres::AngleAxisRotatePoint(turn, p, turned);
    const T scale = exp(log_scale[0]);
    Eigen::Matrix<T, 3, 1> d;
    for (int i = 0; i < 3; ++i) d[i] = scale * turned[i] + shift[i] - said[i];
    Eigen::Map<Eigen::Matrix<T, 3, 1>> r(residual);
    r = sqrt_information.cast<T>() * d;
    return true;
  }
};

struct SimilarityAttitude {
  Eigen::Quaterniond enu_from_camera, said;
  Eigen::Matrix3d sqrt_information;
  template <class T>
  bool operator()(const T* turn, T* residual) const {
    T q[4];
    ceres::AngleAxisToQuaternion(turn, q);
    const Eigen::Quaternion<T> apart =
        Eigen::Quaternion<T>(q[0], q[1], q[2], q[3]) * (enu_from_camera * said.conjugate()).cast<T>();
    const T wxyz[4] = {apart.w(), apart.x(), apart.y(), apart.z()};
    Eigen::Matrix<T, 3, 1> v;
    ceres::QuaternionToAngleAxis(wxyz, v.data());
    Eigen::Map<Eigen::Matrix<T, 3, 1>> r(residual);
    r = sqrt_information.cast<T>() * v;
    return true;
  }
};

Eigen::Matrix3d sqrtInformation(const Eigen::Matrix3d& covariance) {
  return Eigen::Matrix3d(covariance.inverse()).llt().matrixU();
}

constexpr double kLeastPositionNoise = 0.02;   // metres: below this the noise estimate would be an accident
constexpr double kLeastAttitudeNoise = 0.002;  // radians
constexpr double kMostLogScale = 4;            // of one alignment to the telemetry
constexpr double kDelayStep = 0.25;            // of that search
constexpr double kClearlyBetter = 3;           // log-likelihood by which another delay must win
constexpr double kMostDelay = 6;               // seconds that are searched for
constexpr double kLeastStampError = 0.1;  // seconds: what the track's shape between two frames is good for
// A horizon (gyroscopes, levelled by accelerometers) is thrown off by every turn and settles over tens of
// seconds, and does so in the same way on every leg. Taken as noise from frame to frame, that would bend a
// block of parallel legs into a dome.
constexpr double kAttitudeSettles = 30;       // seconds
constexpr double kMostAttitudeWander = 0.99;  // correlation from frame to frame
constexpr double kAssumedHeading = 0.5;       // radians: a heading claimed worse than this was not measured

}  // namespace

// Catmull-Rom through the located frames' centres (non-uniform times), great circles between attitudes.
PoseMap::Earlier PoseMap::earlier(const Frame& frame, double delay_s) const {
  Earlier out;
  // The frames of the same part around the moment, nearest first on each side.
  const std::int64_t t = frame.prior.time_ns - static_cast<std::int64_t>(std::llround(delay_s * 1e9));
  std::array<const Frame*, 2> before{}, after{};
  auto it = located_at_.upper_bound(t);
  for (auto up = it; up != located_at_.end() && after[1] == nullptr; ++up) {
    const Frame& f = frames_.at(up->second);
    if (f.component == frame.component) after[after[0] == nullptr ? 0 : 1] = &f;
  }
  while (it != located_at_.begin() && before[1] == nullptr) {
    const Frame& f = frames_.at((--it)->second);
    if (f.component == frame.component) before[before[0] == nullptr ? 0 : 1] = &f;
  }
  if (before[0] == nullptr)
    std::swap(before[0], after[0]), std::swap(after[0], after[1]);
  else if (after[0] == nullptr)
    after[0] = before[0], before[0] = before[1], before[1] = nullptr;
  if (before[0] == nullptr || after[0] == nullptr) return out;
  const auto seconds = [&](const Frame& f) { return static_cast<double>(f.prior.time_ns - t) * 1e-9; };
  const Frame &a = *before[0], &b = *after[0];
  const double ta = seconds(a), tb = seconds(b), span = tb - ta, u = -ta / span;
  const auto slope = [&](const Frame* from, const Frame* to) -> Eigen::Vector3d {
    return (to->view.position - from->view.position) / (seconds(*to) - seconds(*from));
  };
  Eigen::Vector3d then;
  if (u < 0 || u > 1) {  // outside: straight on
    out.velocity = slope(&a, &b);
    then = u < 0 ? Eigen::Vector3d(a.view.position + out.velocity * (u * span))
                 : Eigen::Vector3d(b.view.position + out.velocity * ((u - 1) * span));
    out.beyond_s = (u < 0 ? -u : u - 1) * span;
  } else {
    const Eigen::Vector3d va = slope(before[1] != nullptr ? before[1] : &a, &b);
    const Eigen::Vector3d vb = slope(&a, after[1] != nullptr ? after[1] : &b);
    const double u2 = u * u, u3 = u2 * u;
    const Eigen::Vector3d &pa = a.view.position, &pb = b.view.position;
    then = (2 * u3 - 3 * u2 + 1) * pa + (u3 - 2 * u2 + u) * span * va + (3 * u2 - 2 * u3) * pb +
           (u3 - u2) * span * vb;
    out.velocity = (6 * u2 - 6 * u) / span * (pa - pb) + (3 * u2 - 4 * u + 1) * va + (3 * u2 - 2 * u) * vb;
  }
  for (const auto& change :
       {before[1] != nullptr ? Eigen::Vector3d(slope(before[1], &a) - slope(&a, &b))
                             : Eigen::Vector3d::Zero().eval(),
        after[1] != nullptr && after[1] != &b ? Eigen::Vector3d(slope(&a, &b) - slope(&b, after[1]))
                                              : Eigen::Vector3d::Zero().eval()})
    out.velocity_change = std::max(out.velocity_change, change.norm());
  out.displacement = then - frame.view.position;
  const Eigen::Vector3d whole =
      rotationVector(b.view.world_from_camera * a.view.world_from_camera.conjugate());
  const Eigen::Quaterniond q = fromRotationVector(whole * std::clamp(u, 0.0, 1.0)) * a.view.world_from_camera;
  out.turn = q * frame.view.world_from_camera.conjugate();
  return out;
}

void PoseMap::fillPrior(const Frame& frame, BundleFrame& out) const {
  out.has_position_prior = out.has_attitude_prior = true;
  out.prior_position = frame.prior.position;
  out.prior_enu_from_camera = frame.prior.enu_from_camera;
  const double horizontal = noise_.horizontal * wander_.horizontal;
  const Eigen::Vector3d p(horizontal, horizontal, noise_.vertical * wander_.vertical);
  const Eigen::Vector3d a = wander_.attitude * Eigen::Vector3d(noise_.tilt, noise_.tilt, noise_.heading);
  out.prior_position_covariance =
      p.asDiagonal() * frame.prior.covariance.topLeftCorner<3, 3>() * p.asDiagonal();
  out.prior_attitude_covariance =
      a.asDiagonal() * frame.prior.covariance.bottomRightCorner<3, 3>() * a.asDiagonal();
  if (!frame.located) return;
  const Earlier then = earlier(frame, shared_.delay_s);
  out.displacement = then.displacement;
  out.velocity = then.velocity;
  if (frame.prior.covariance(5, 5) < kAssumedHeading * kAssumedHeading) out.turn = then.turn;
  // In a turn the track between two frames, and so the delay's effect, is only roughly known.
  const double bend = 0.25 * then.velocity_change * std::max(kLeastStampError, sigmas_.delay_s);
  out.prior_position_covariance += Eigen::Matrix3d::Identity() * (bend * bend);
  if (then.beyond_s > 0) {  // carried on past the ends of the track: half of the way may be wrong
    const double guess = 0.5 * then.velocity.norm() * then.beyond_s;
    out.prior_position_covariance += Eigen::Matrix3d::Identity() * (guess * guess);
  }
}

// Variance components: the telemetry's noise from frame to frame by its own residuals, one factor for each
// of horizontal and vertical position, tilt and heading (robust: median absolute residual).
void PoseMap::estimateNoise(const std::vector<FrameId>& frames) {
  if (frames.size() < 8) return;
  std::array<std::vector<double>, 4> sizes;  // in claimed sigmas
  std::array<double, 4> claimed{};
  std::vector<Eigen::Vector3d> in_order;
  for (const FrameId id : frames) {
    const Frame& frame = frames_.at(id);
    const Earlier then = earlier(frame, shared_.delay_s);
    if (then.beyond_s > 0) continue;
    const Eigen::Matrix<double, 6, 1> sigma = frame.prior.covariance.diagonal().cwiseSqrt();
    const Eigen::Vector3d p = frame.view.position + then.displacement +
                              frame.view.world_from_camera * shared_.lever_m + shared_.offset_m -
                              frame.prior.position;
    const Eigen::Vector3d a =
        rotationVector(then.turn * frame.view.world_from_camera *
                       (frame.prior.enu_from_camera * fromRotationVector(shared_.boresight)).conjugate());
    in_order.push_back(p);
    for (int i = 0; i < 3; ++i) {
      sizes[i < 2 ? 0 : 1].push_back(std::abs(p[i]) / sigma[i]);
      sizes[i < 2 ? 2 : 3].push_back(std::abs(a[i]) / sigma[3 + i]);
    }
    claimed = {sigma[0], sigma[2], sigma[3], sigma[5]};
  }
  const double n = static_cast<double>(frames.size());
  const double freedom = std::sqrt(n / std::max(3.0, n - 4));
  const auto factor = [&](std::size_t i, double least) {
    if (sizes[i].size() < 8) return 1.0;
    return std::clamp(1.4826 * median(sizes[i]) * freedom, std::min(1.0, least / claimed[i]), 30.0);
  };
  // A receiver's errors wander: with the correlation r from frame to frame (AR(1)), n residuals are worth
  // n (1 - r) / (1 + r) independent ones.
  Eigen::Vector3d same = Eigen::Vector3d::Constant(1e-9), next = Eigen::Vector3d::Zero();
  for (std::size_t i = 1; i < in_order.size(); ++i) {
    const Eigen::Vector3d scale(3 * median(sizes[0]) * claimed[0], 3 * median(sizes[0]) * claimed[0],
                                3 * median(sizes[1]) * claimed[1]);
    const Eigen::Vector3d a = in_order[i - 1].cwiseMin(scale).cwiseMax(-scale);
    const Eigen::Vector3d b = in_order[i].cwiseMin(scale).cwiseMax(-scale);
    same += 0.5 * (a.cwiseAbs2() + b.cwiseAbs2());
    next += a.cwiseProduct(b);
  }
  const auto wander = [](double r) { return std::sqrt((1 + r) / (1 - r)); };
  const auto correlation = [](double covariance, double variance) {
    return std::clamp(covariance / variance, 0.0, 0.95);
  };
  noise_.horizontal = factor(0, kLeastPositionNoise);
  noise_.vertical = factor(1, kLeastPositionNoise);
  wander_.horizontal = wander(correlation(next.head<2>().sum(), same.head<2>().sum()));
  wander_.vertical = wander(correlation(next.z(), same.z()));
  std::vector<double> steps;  // seconds between neighbouring frames
  for (std::size_t i = 1; i < frames.size(); ++i)
    steps.push_back(1e-9 * std::abs(static_cast<double>(frames_.at(frames[i]).prior.time_ns -
                                                        frames_.at(frames[i - 1]).prior.time_ns)));
  wander_.attitude = wander(std::min(kMostAttitudeWander, std::exp(-median(steps) / kAttitudeSettles)));
  noise_.tilt = factor(2, kLeastAttitudeNoise);
  noise_.heading = factor(3, kLeastAttitudeNoise);
}

// One similarity for a part of the map, from all that the telemetry says about its frames: least squares
// with robust losses, begun at four headings.
void PoseMap::alignToTelemetry(int component) {
  std::vector<FrameId> members;
  for (const FrameId id : arrived_)
    if (frames_.at(id).located && frames_.at(id).component == component) members.push_back(id);
  if (members.size() < 2) return;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero(), said_centre = Eigen::Vector3d::Zero();
  std::vector<BundleFrame> priors(members.size());
  for (std::size_t i = 0; i < members.size(); ++i) {
    fillPrior(frames_.at(members[i]), priors[i]);
    centre += frames_.at(members[i]).view.position / static_cast<double>(members.size());
    said_centre += priors[i].prior_position / static_cast<double>(members.size());
  }
  double least = 1e300;
  double scale = 1;
  Eigen::Vector3d turn = Eigen::Vector3d::Zero(), shift = Eigen::Vector3d::Zero();
  for (int start = 0; start < (members.size() < 3 ? 1 : 4); ++start) {
    double s = 0;
    Eigen::Vector3d r(0, 0, start * 1.5707963 - (start > 2 ? 6.2831853 : 0)), t = Eigen::Vector3d::Zero();
    ceres::Problem problem;
    for (std::size_t i = 0; i < members.size(); ++i) {
      const Frame& frame = frames_.at(members[i]);
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<SimilarityPosition, 3, 1, 3, 3>(new SimilarityPosition{
              frame.view.position + priors[i].displacement - centre, priors[i].prior_position - said_centre,
              sqrtInformation(priors[i].prior_position_covariance)}),
          new ceres::CauchyLoss(3), &s, r.data(), t.data());
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<SimilarityAttitude, 3, 3>(new SimilarityAttitude{
              priors[i].turn * frame.view.world_from_camera, priors[i].prior_enu_from_camera,
              sqrtInformation(priors[i].prior_attitude_covariance)}),
          new ceres::CauchyLoss(3), r.data());
    }
    problem.SetParameterLowerBound(&s, 0, -kMostLogScale);
    problem.SetParameterUpperBound(&s, 0, kMostLogScale);
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::DENSE_QR;
    solver.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem, &summary);
    if (!summary.IsSolutionUsable() || summary.final_cost >= least) continue;
    least = summary.final_cost;
    scale = std::exp(s);
    turn = r;
    shift = t;
  }
  if (least == 1e300) return;
  move(members, scale, fromRotationVector(turn), centre, shift + said_centre);
}

// The telemetry's delay from the shape of the track alone: for each candidate a robust similarity in the
// plane between the adjusted positions and the telemetry at that delay. Moves shared_.delay_s only when
// another delay explains the track clearly better; the adjustment refines it.
void PoseMap::searchDelay(const std::vector<FrameId>& frames) {
  if (frames.size() < 12 || prior_sigmas_.delay_s <= 0) return;
  double noise = 0;
  const auto cost = [&](double delay, bool measure) {
    std::vector<std::complex<double>> from, to;
    std::vector<double> weight;
    for (const FrameId id : frames) {
      const Frame& frame = frames_.at(id);
      const Earlier then = earlier(frame, delay);
      if (then.beyond_s > 0) continue;
      from.emplace_back(frame.view.position.x() + then.displacement.x(),
                        frame.view.position.y() + then.displacement.y());
      to.emplace_back(frame.prior.position.x(), frame.prior.position.y());
      weight.push_back(1);
    }
    if (from.size() < 10) return 1e300;
    std::vector<double> r(from.size());
    for (int round = 0; round < 6; ++round) {
      std::complex<double> a, b, ab;
      double sum = 0, aa = 0;
      for (std::size_t i = 0; i < from.size(); ++i) {
        a += weight[i] * from[i];
        b += weight[i] * to[i];
        sum += weight[i];
      }
      a /= sum;
      b /= sum;
      for (std::size_t i = 0; i < from.size(); ++i) {
        ab += weight[i] * std::conj(from[i] - a) * (to[i] - b);
        aa += weight[i] * std::norm(from[i] - a);
      }
      const std::complex<double> m = ab / std::max(aa, 1e-9);
      for (std::size_t i = 0; i < from.size(); ++i) r[i] = std::abs(to[i] - b - m * (from[i] - a));
      if (measure) noise = std::max(0.1, median(r));
      for (std::size_t i = 0; i < from.size(); ++i) weight[i] = 1 / (1 + r[i] * r[i] / (noise * noise));
    }
    double total = 0;
    for (const double x : r) total += 0.5 * std::log1p(x * x / (noise * noise));
    // Frames whose telemetry would lie past the track's end count as average.
    return total * static_cast<double>(frames.size()) / static_cast<double>(r.size()) +
           0.5 * std::pow(delay / prior_sigmas_.delay_s, 2);
  };
  cost(shared_.delay_s, true);
  double best = shared_.delay_s, least = cost(best, false);
  const double present = least;
  const double reach = std::min(kMostDelay, 3 * prior_sigmas_.delay_s);
  for (double d = -reach; d <= reach; d += kDelayStep) {
    const double c = cost(d, false);
    if (c < least) {
      least = c;
      best = d;
    }
  }
  if (least < present - kClearlyBetter) shared_.delay_s = best;
  // What the shape says is the prior of the adjustment: turns show a delay even where the telemetry wanders
  // so slowly that the adjustment, which takes residuals one by one, has to distrust them.
  prior_.delay_s = 0;
  delay_sigma_ = prior_sigmas_.delay_s;
  if (least > cost(0, false) - kClearlyBetter) return;
  double width = kDelayStep;
  while (width < reach && 0.5 * (cost(best - width, false) + cost(best + width, false)) < least + 0.5)
    width += kDelayStep;
  prior_.delay_s = best;
  delay_sigma_ = std::min(prior_sigmas_.delay_s, width * wander_.horizontal);
}

}  // namespace overfly::tiling::adjust
