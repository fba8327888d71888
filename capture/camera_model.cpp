#include "capture/camera_model.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace overfly::capture {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kMaxSide = 65500;  // libjpeg's limit, and more than any camera has

using Polynomial = std::vector<double>;  // coefficient i belongs to r^i

Polynomial multiply(const Polynomial& a, const Polynomial& b) {
  Polynomial product(a.size() + b.size() - 1, 0.0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t j = 0; j < b.size(); ++j) product[i + j] += a[i] * b[j];
  }
  return product;
}

Polynomial subtract(Polynomial a, const Polynomial& b) {
  a.resize(std::max(a.size(), b.size()), 0.0);
  for (std::size_t i = 0; i < b.size(); ++i) a[i] -= b[i];
  return a;
}

Polynomial derivative(const Polynomial& a) {
  Polynomial result;
  for (std::size_t i = 1; i < a.size(); ++i) result.push_back(static_cast<double>(i) * a[i]);
  if (result.empty()) result.push_back(0.0);
  return result;
}

// Smallest positive real root, infinity when there is none: eigenvalues of the companion matrix. A pair of
// nearly real complex roots (the polynomial nearly touches zero) counts as a root, on the safe side.
double smallestPositiveRoot(Polynomial p) {
  const double largest = std::abs(
      *std::max_element(p.begin(), p.end(), [](double a, double b) { return std::abs(a) < std::abs(b); }));
  while (p.size() > 1 && std::abs(p.back()) <= 1e-18 * largest) p.pop_back();
  const auto degree = static_cast<Eigen::Index>(p.size()) - 1;
  if (degree < 1) return kInfinity;
  Eigen::MatrixXd companion = Eigen::MatrixXd::Zero(degree, degree);
  for (Eigen::Index i = 0; i < degree; ++i) {
    companion(i, degree - 1) = -p[static_cast<std::size_t>(i)] / p.back();
    if (i > 0) companion(i, i - 1) = 1.0;
  }
  if (!companion.allFinite()) return 0.0;
  const Eigen::VectorXcd roots = Eigen::EigenSolver<Eigen::MatrixXd>(companion, false).eigenvalues();
  double smallest = kInfinity;
  for (const auto& root : roots) {
    if (root.real() > 0 && std::abs(root.imag()) <= 1e-7 * std::abs(root)) {
      smallest = std::min(smallest, root.real());
    }
  }
  return smallest;
}

// The Jacobian of OpenCV's radial-tangential map is symmetric: the radial part has the eigenvalues f'(r) and
// f(r)/r with f(r) = r N(r^2)/D(r^2); the tangential part's smallest eigenvalue at radius r is at least
// -6 |p| r. While both eigenvalues exceed 6 |p| r the Jacobian is positive definite, so the map is one to
// one on that (convex) disk. Returns the radius of the largest such disk.
double radialTangentialRadius(const std::vector<double>& k) {
  const auto at = [&](std::size_t i) { return i < k.size() ? k[i] : 0.0; };
  const Polynomial n = {1, 0, at(0), 0, at(1), 0, at(4)};
  const Polynomial d = {1, 0, at(5), 0, at(6), 0, at(7)};
  const Polynomial six_p_r = {0, 6 * std::hypot(at(2), at(3))};
  const Polynomial r = {0, 1};
  const Polynomial f = multiply(r, n);  // numerator of f
  const Polynomial bound = multiply(six_p_r, multiply(d, d));
  const Polynomial slope = subtract(subtract(multiply(derivative(f), d), multiply(f, derivative(d))), bound);
  const Polynomial ratio = subtract(multiply(n, d), bound);
  return std::min({smallestPositiveRoot(d), smallestPositiveRoot(slope), smallestPositiveRoot(ratio)});
}

double fisheyeRadius(const std::vector<double>& k) {
  const auto at = [&](std::size_t i) { return i < k.size() ? k[i] : 0.0; };
  const Polynomial slope = {1, 0, 3 * at(0), 0, 5 * at(1), 0, 7 * at(2), 0, 9 * at(3)};
  return std::min(smallestPositiveRoot(slope), std::numbers::pi);
}

// project() and unproject() ask for the radius at every point, and it costs some 50 us: each thread keeps
// its last few answers, so that a flight with several cameras does not compute it at every turn.
double cachedRadius(const CameraModel& camera) {
  struct Known {
    CameraModel::Kind kind = CameraModel::Kind::Pinhole;
    std::vector<double> distortion;
    double radius = kInfinity;
  };
  thread_local std::array<Known, 8> cache;
  thread_local std::size_t newest = 0;
  for (std::size_t i = 0; i < cache.size(); ++i) {
    const Known& known = cache[(newest + i) % cache.size()];
    if (known.kind == camera.kind && known.distortion == camera.distortion) {
      newest = (newest + i) % cache.size();
      return known.radius;
    }
  }
  newest = (newest + cache.size() - 1) % cache.size();
  cache[newest] = {camera.kind, camera.distortion, camera.validRadius()};
  return cache[newest].radius;
}

struct Distorted {
  Eigen::Vector2d value;
  Eigen::Matrix2d jacobian;
};

double radialFactor(const std::vector<double>& k, double r2) {
  double factor = 1 + r2 * (k[0] + r2 * (k[1] + (k.size() > 4 ? r2 * k[4] : 0.0)));
  if (k.size() > 5) factor /= 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
  return factor;
}

// OpenCV's calib3d documentation, "Detailed Description", the distortion model (without thin prism, tilt).
Eigen::Vector2d distort(const std::vector<double>& k, const Eigen::Vector2d& p) {
  const double r2 = p.squaredNorm();
  const double xy2 = 2 * p.x() * p.y();
  return radialFactor(k, r2) * p + Eigen::Vector2d(k[2] * xy2 + k[3] * (r2 + 2 * p.x() * p.x()),
                                                   k[2] * (r2 + 2 * p.y() * p.y()) + k[3] * xy2);
}

Distorted distortWithJacobian(const std::vector<double>& k, const Eigen::Vector2d& p) {
  const double r2 = p.squaredNorm();
  const double k3 = k.size() > 4 ? k[4] : 0.0;
  const double n = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k3));
  const double dn = k[0] + r2 * (2 * k[1] + r2 * 3 * k3);  // by r^2
  double factor = n, slope = dn;
  if (k.size() > 5) {
    const double d = 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
    const double dd = k[5] + r2 * (2 * k[6] + r2 * 3 * k[7]);
    factor = n / d;
    slope = (dn * d - n * dd) / (d * d);
  }
  Distorted result;
  result.value = distort(k, p);
  result.jacobian = factor * Eigen::Matrix2d::Identity() + 2 * slope * p * p.transpose();
  const double p1 = k[2], p2 = k[3];
  Eigen::Matrix2d tangential;
  tangential << 2 * p1 * p.y() + 6 * p2 * p.x(), 2 * p1 * p.x() + 2 * p2 * p.y(),
      2 * p1 * p.x() + 2 * p2 * p.y(), 6 * p1 * p.y() + 2 * p2 * p.x();
  result.jacobian += tangential;
  return result;
}

// Solves f(r) = target for a strictly increasing f on [0, limit): Newton kept inside a shrinking bracket.
// The caller has made sure that the target lies in f's range.
template <typename F, typename Slope>
double solveIncreasing(const F& f, const Slope& slope, double target, double limit) {
  double low = 0, high = limit;
  double r = std::min(target, 0.5 * limit);
  for (int i = 0; i < 100; ++i) {
    const double error = f(r) - target;
    if (std::abs(error) <= 1e-15 * (1 + target)) break;
    (error > 0 ? high : low) = r;
    double next = r - error / slope(r);
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (next == r) break;
    r = next;
  }
  return r;
}

// Undistorted point of a distorted one, both on the plane z = 1. Starts from the purely radial inverse,
// then damped Newton on the whole map; nullopt when the solution is not inside the disk of one-to-one.
std::optional<Eigen::Vector2d> undistort(const std::vector<double>& k, const Eigen::Vector2d& target,
                                         double radius) {
  const double target_norm = target.norm();
  if (target_norm == 0 && k[2] == 0 && k[3] == 0) return target;
  const auto f = [&](double r) { return r * radialFactor(k, r * r); };
  const auto slope = [&](double r) {
    const Distorted at =
        distortWithJacobian({k[0], k[1], 0, 0, k.size() > 4 ? k[4] : 0.0, k.size() > 5 ? k[5] : 0.0,
                             k.size() > 5 ? k[6] : 0.0, k.size() > 5 ? k[7] : 0.0},
                            {r, 0});
    return at.jacobian(0, 0);
  };
  const double inner = radius < kInfinity ? 0.9999 * radius : std::max(1e3, 1e3 * target_norm);
  const double start_radius = f(inner) <= target_norm ? inner : solveIncreasing(f, slope, target_norm, inner);
  Eigen::Vector2d p =
      target_norm > 0 ? Eigen::Vector2d(target * (start_radius / target_norm)) : Eigen::Vector2d(0, 0);

  const double tolerance = 1e-14 * (1 + target_norm);
  Distorted at = distortWithJacobian(k, p);
  double error = (at.value - target).norm();
  for (int i = 0; i < 60 && error > tolerance; ++i) {
    const Eigen::Vector2d step = at.jacobian.inverse() * (target - at.value);
    double share = 1;
    bool better = false;
    for (int halvings = 0; halvings < 40; ++halvings, share *= 0.5) {
      const Eigen::Vector2d candidate = p + share * step;
      if (!(candidate.norm() < radius)) continue;
      const Distorted there = distortWithJacobian(k, candidate);
      const double candidate_error = (there.value - target).norm();
      if (!(candidate_error < error)) continue;
      p = candidate;
      at = there;
      error = candidate_error;
      better = true;
      break;
    }
    if (!better) break;
  }
  if (!(error <= 1e-11 * (1 + target_norm)) || !(p.norm() < radius)) return std::nullopt;
  return p;
}

}  // namespace

std::optional<Eigen::Vector2d> CameraModel::project(const Eigen::Vector3d& point) const {
  if (!point.allFinite()) return std::nullopt;
  Eigen::Vector2d on_plane;
  if (kind == Kind::Fisheye) {
    const double side = std::hypot(point.x(), point.y());
    if (side == 0 && !(point.z() > 0)) return std::nullopt;
    const double theta = std::atan2(side, point.z());
    if (!(theta < cachedRadius(*this))) return std::nullopt;
    const double t2 = theta * theta;
    const auto& k = distortion;
    const double distorted = theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
    on_plane = side > 0 ? Eigen::Vector2d(point.head<2>() * (distorted / side)) : Eigen::Vector2d(0, 0);
  } else {
    if (!(point.z() > 0)) return std::nullopt;
    on_plane = point.head<2>() / point.z();
    if (kind == Kind::RadialTangential) {
      if (!(on_plane.norm() < cachedRadius(*this))) return std::nullopt;
      on_plane = distort(distortion, on_plane);
    }
  }
  const Eigen::Vector2d pixel(fx * on_plane.x() + cx, fy * on_plane.y() + cy);
  if (!pixel.allFinite()) return std::nullopt;
  return pixel;
}

std::optional<Eigen::Vector3d> CameraModel::unproject(const Eigen::Vector2d& pixel) const {
  if (!pixel.allFinite()) return std::nullopt;
  const Eigen::Vector2d on_plane((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  if (kind == Kind::Pinhole) return on_plane.homogeneous().normalized();
  const double radius = cachedRadius(*this);
  if (kind == Kind::RadialTangential) {
    const auto p = undistort(distortion, on_plane, radius);
    if (!p) return std::nullopt;
    return p->homogeneous().normalized();
  }
  const double distorted = on_plane.norm();
  if (distorted == 0) return Eigen::Vector3d::UnitZ();
  const auto& k = distortion;
  const auto f = [&](double t) {
    const double t2 = t * t;
    return t * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
  };
  const auto slope = [&](double t) {
    const double t2 = t * t;
    return 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])));
  };
  if (!(distorted < f(radius))) return std::nullopt;
  const double theta = solveIncreasing(f, slope, distorted, radius);
  const Eigen::Vector2d side = on_plane * (std::sin(theta) / distorted);
  return Eigen::Vector3d(side.x(), side.y(), std::cos(theta)).normalized();
}

double CameraModel::validRadius() const {
  switch (kind) {
    case Kind::Pinhole:
      return kInfinity;
    case Kind::RadialTangential:
      return radialTangentialRadius(distortion);
    case Kind::Fisheye:
      return fisheyeRadius(distortion);
  }
  return 0;
}

CameraModel CameraModel::scaled(double factor) const {
  CameraModel result = *this;
  result.width = static_cast<int>(std::lround(width * factor));
  result.height = static_cast<int>(std::lround(height * factor));
  result.fx *= factor;
  result.fy *= factor;
  result.cx *= factor;
  result.cy *= factor;
  return result;
}

std::optional<std::string> CameraModel::problem() const {
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide) {
    return fmt::format("the image size {}x{} is not within 1..{}", width, height, kMaxSide);
  }
  const double longest = std::max(width, height);
  for (const auto& [name, value] : {std::pair{"fx", fx}, std::pair{"fy", fy}}) {
    if (!(value > 0.01 * longest && value < 1000 * longest)) {
      return fmt::format("{} = {} px is not a focal length for an image of {}x{}", name, value, width,
                         height);
    }
  }
  for (const auto& [name, value] : {std::pair{"cx", cx}, std::pair{"cy", cy}}) {
    if (!(std::abs(value) < 10 * longest)) {
      return fmt::format("{} = {} px is not a principal point for an image of {}x{}", name, value, width,
                         height);
    }
  }
  const std::size_t count = distortion.size();
  const bool right_count = kind == Kind::Pinhole   ? count == 0
                           : kind == Kind::Fisheye ? count == 4
                                                   : count == 4 || count == 5 || count == 8;
  if (!right_count) {
    return fmt::format("{} distortion coefficients do not fit the camera model ({})", count,
                       kind == Kind::Pinhole   ? "pinhole: none"
                       : kind == Kind::Fisheye ? "fisheye: 4"
                                               : "radial-tangential: 4, 5 or 8");
  }
  for (const double coefficient : distortion) {
    if (!(std::abs(coefficient) < 1e6)) {
      return fmt::format("the distortion coefficient {} is not usable", coefficient);
    }
  }
  if (!unproject({0.5 * width, 0.5 * height})) {
    return "the distortion is not one to one at the image's centre";
  }
  return std::nullopt;
}

}  // namespace overfly::capture
