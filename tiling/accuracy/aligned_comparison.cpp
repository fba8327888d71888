#include "tiling/accuracy/aligned_comparison.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <vector>

namespace overfly::tiling {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Vector7 = Eigen::Matrix<double, 7, 1>;

constexpr double kHuber = 1.345;  // sigmas: 95 % efficient for normal errors
constexpr int kRounds = 10;

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double robustSigma(const std::vector<double>& residuals) {
  std::vector<double> sizes;
  for (const double r : residuals) sizes.push_back(std::abs(r));
  return std::max(1e-6, 1.4826 * median(std::move(sizes)));
}

double huberWeight(double residual, double sigma) {
  const double size = std::abs(residual) / sigma;
  return size <= kHuber ? 1 : kHuber / size;
}

// Map surface under a place of the local ENU.
class Surface {
 public:
  Surface(const std::map<geo::TileKey, Tile>& tiles, const geo::TileLattice& lattice, int zoom,
          double anchor_px, const geo::LocalFrame& local)
      : tiles_(tiles), lattice_(lattice), zoom_(zoom), anchor_px_(anchor_px), local_(local) {}
  // Surface minus the point's own height, metres; nullopt where nothing was measured.
  [[nodiscard]] std::optional<double> above(const Eigen::Vector3d& enu) const {
    const geo::Geodetic place = geo::geodeticFromEcef(local_.ecefFromEnu(enu));
    const auto height = heightAt(tiles_, lattice_, zoom_, anchor_px_, place);
    if (!height) return std::nullopt;
    return *height - place.height_m;
  }

 private:
  const std::map<geo::TileKey, Tile>& tiles_;
  const geo::TileLattice& lattice_;
  int zoom_;
  double anchor_px_;
  const geo::LocalFrame& local_;
};

// Gauss-Newton on the distances of the points from the surface, along the vertical.
geo::Similarity refine(const Surface& surface, std::span<const Eigen::Vector3d> points, double gsd_m,
                       const geo::Similarity& start) {
  geo::Similarity fit = start;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) centre += p / static_cast<double>(points.size());
  // Shift, turn about the centre, log scale; summed up from the start for their priors.
  Vector7 moved = Vector7::Zero(), prior_sigma;
  prior_sigma << 1, 1, 1e3, 1, 1, 0.01, 0.005;
  for (int round = 0; round < kRounds; ++round) {
    std::vector<double> residuals;
    std::vector<Vector7> slopes;
    const Eigen::Vector3d pivot = fit(centre);
    for (const Eigen::Vector3d& p : points) {
      const Eigen::Vector3d x = fit(p), d = x - pivot;
      const auto here = surface.above(x);
      const double h = 2 * gsd_m;
      const auto east = surface.above(x + h * Eigen::Vector3d::UnitX());
      const auto west = surface.above(x - h * Eigen::Vector3d::UnitX());
      const auto north = surface.above(x + h * Eigen::Vector3d::UnitY());
      const auto south = surface.above(x - h * Eigen::Vector3d::UnitY());
      if (!here || !east || !west || !north || !south) continue;
      // Along an edge a slope says nothing that is linear.
      const Eigen::Vector3d n(std::clamp((*east - *west) / (2 * h), -1.0, 1.0),
                              std::clamp((*north - *south) / (2 * h), -1.0, 1.0), -1);
      Vector7 j;
      j << n, d.cross(n), n.dot(d);
      residuals.push_back(*here);
      slopes.push_back(j);
    }
    if (residuals.size() < 20) return start;
    const double sigma = robustSigma(residuals);
    Eigen::Matrix<double, 7, 7> normal = prior_sigma.cwiseAbs2().cwiseInverse().asDiagonal();
    Vector7 right = -prior_sigma.cwiseAbs2().cwiseInverse().cwiseProduct(moved);
    for (std::size_t i = 0; i < residuals.size(); ++i) {
      const double weight = huberWeight(residuals[i], sigma) / (sigma * sigma);
      normal += weight * slopes[i] * slopes[i].transpose();
      right -= weight * residuals[i] * slopes[i];
    }
    const Vector7 step = normal.ldlt().solve(right);
    moved += step;
    const Eigen::Vector3d r = step.segment<3>(3);
    const Eigen::Matrix3d turn = r.norm() > 0 ? Eigen::AngleAxisd(r.norm(), r.normalized()).toRotationMatrix()
                                              : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
    const double scale = std::exp(step[6]);
    fit.shift = scale * (turn * (fit.shift - pivot)) + pivot + step.head<3>();
    fit.turn = turn * fit.turn;
    fit.scale *= scale;
    if (step.head<3>().norm() < 1e-4 && r.norm() < 1e-6) break;
  }
  return fit;
}

void fitDome(const std::vector<Eigen::Vector2d>& places, const std::vector<double>& errors,
             AlignedComparison& out) {
  if (places.size() < 20) return;
  Eigen::Vector2d low = places[0], high = places[0];
  for (const Eigen::Vector2d& p : places) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Eigen::Vector2d centre = 0.5 * (low + high);
  const auto row = [&](const Eigen::Vector2d& p) {
    const Eigen::Vector2d u = (p - centre) / AlignedComparison::kDomeUnit;
    Vector6 v;
    v << 1, u.x(), u.y(), u.x() * u.x(), u.x() * u.y(), u.y() * u.y();
    return v;
  };
  Vector6 fit = Vector6::Zero();
  for (int round = 0; round < kRounds; ++round) {
    std::vector<double> residuals;
    for (std::size_t i = 0; i < places.size(); ++i) residuals.push_back(errors[i] - row(places[i]).dot(fit));
    const double sigma = robustSigma(residuals);
    Eigen::Matrix<double, 6, 6> normal = 1e-9 * Eigen::Matrix<double, 6, 6>::Identity();
    Vector6 right = Vector6::Zero();
    for (std::size_t i = 0; i < places.size(); ++i) {
      const Vector6 v = row(places[i]);
      const double weight = huberWeight(residuals[i], sigma);
      normal += weight * v * v.transpose();
      right += weight * errors[i] * v;
    }
    fit = normal.ldlt().solve(right);
  }
  out.dome = fit.tail<3>();
  // x^2, xy, y^2 less the plane that fits each best over the points.
  Eigen::MatrixX3d planes(places.size(), 3), squares(places.size(), 3);
  for (std::size_t i = 0; i < places.size(); ++i) {
    planes.row(static_cast<Eigen::Index>(i)) = row(places[i]).head<3>().transpose();
    squares.row(static_cast<Eigen::Index>(i)) = row(places[i]).tail<3>().transpose();
  }
  const Eigen::Matrix3d plane = planes.colPivHouseholderQr().solve(squares);
  const auto form = [&](const Eigen::Vector2d& p) -> Eigen::Vector3d {
    return row(p).tail<3>() - plane.transpose() * row(p).head<3>();
  };
  for (const Eigen::Vector2d& corner :
       {low, high, Eigen::Vector2d(low.x(), high.y()), Eigen::Vector2d(high.x(), low.y())}) {
    const Eigen::Vector3d here = form(corner);
    if (out.corner_form.isZero() || std::abs(here.dot(out.dome)) > out.dome_corner) {
      out.dome_corner = std::abs(here.dot(out.dome));
      out.corner_form = here;
    }
  }
  for (const Eigen::Vector2d& p : places)
    out.rms_form += form(p) * form(p).transpose() / static_cast<double>(places.size());
  out.dome_rms = std::sqrt(out.dome.dot(out.rms_form * out.dome));
}

}  // namespace

AlignedComparison compareAligned(const std::map<geo::TileKey, Tile>& tiles, const geo::TileLattice& lattice,
                                 int zoom, double anchor_px, std::span<const ReferencePoint> points,
                                 const geo::LocalFrame& local, double gsd_m, const geo::Similarity& start) {
  AlignedComparison out;
  const Surface surface(tiles, lattice, zoom, anchor_px, local);
  std::vector<Eigen::Vector3d> fitting, judging;
  std::vector<int> tracks;
  double mean_track = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    mean_track += points[i].track / static_cast<double>(points.size());
    const Eigen::Vector3d enu = local.enuFromEcef(geo::ecefFromGeodetic(points[i].place));
    if (i % 2 == 0) {
      fitting.push_back(enu);
    } else {
      judging.push_back(enu);
      tracks.push_back(points[i].track);
    }
  }
  out.fitted_points = fitting.size();
  out.map_from_reference = refine(surface, fitting, gsd_m, start);
  std::vector<double> strong, all;
  std::vector<Eigen::Vector2d> places;
  std::size_t strong_points = 0;
  const long strong_track = std::lround(mean_track);
  for (std::size_t i = 0; i < judging.size(); ++i) {
    const bool is_strong = tracks[i] >= strong_track;
    strong_points += is_strong ? 1 : 0;
    const auto above = surface.above(out.map_from_reference(judging[i]));
    if (!above) continue;
    all.push_back(*above / out.map_from_reference.scale / gsd_m);
    places.emplace_back(judging[i].head<2>());
    if (is_strong) strong.push_back(all.back());
  }
  fitDome(places, all, out);
  out.strong = statisticsOf(std::move(strong), strong_points);
  out.all = statisticsOf(std::move(all), judging.size());
  return out;
}

}  // namespace overfly::tiling
