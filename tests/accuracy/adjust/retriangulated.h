#pragma once
#include <Eigen/QR>
#include <cmath>
#include <optional>
#include <vector>

#include "capture/geo/similarity.h"
#include "tests/accuracy/adjust/recorded.h"
#include "tiling/adjust/geometry.h"

// What adjusted poses and their lens would make of the ground, without a map: the reference points go into
// the pictures by the reference poses and lens, and back to the ground by the adjusted ones.
namespace overfly::tests {

struct Retriangulated {
  std::size_t points = 0;   // seen by at least three frames
  double residual_px = 0;   // root mean square re-projection in the adjusted frames: do the two contradict?
  double height_rms_m = 0;  // after a similarity
  double dome_rms_m = 0;    // of the quadratic part of the heights, less a plane
};

// `views`: the adjusted poses by index of frame, in the reference's ENU; nullopt where a frame has none.
inline Retriangulated retriangulate(const RecordedFlight& flight, const capture::CameraModel& lens,
                                    const std::vector<std::optional<tiling::adjust::View>>& views) {
  Retriangulated out;
  std::vector<Eigen::Vector3d> reference, made;
  double squares = 0, sightings = 0;
  for (const auto& point : flight.points) {
    std::vector<tiling::adjust::View> seen_by;
    std::vector<Eigen::Vector2d> seen;
    for (std::size_t i = 0; i < views.size(); ++i) {
      const auto& r = flight.reference[i];
      const auto px = flight.reference_camera.project(r.enu_from_camera.conjugate() * (point - r.position));
      if (!views[i] || !px || px->x() < 0 || px->y() < 0 || px->x() > lens.width || px->y() > lens.height)
        continue;
      const auto ray = lens.unproject(*px);
      if (!ray) continue;
      seen_by.push_back(*views[i]);
      seen.emplace_back(ray->head<2>() / ray->z());
    }
    const auto x = seen.size() < 3 ? std::nullopt : tiling::adjust::triangulate(seen_by, seen);
    if (!x) continue;
    reference.push_back(point);
    made.push_back(*x);
    for (std::size_t k = 0; k < seen.size(); ++k) {
      const Eigen::Vector3d c = seen_by[k].world_from_camera.conjugate() * (*x - seen_by[k].position);
      squares += (lens.fx * (c.head<2>() / c.z() - seen[k])).squaredNorm();
      sightings += 1;
    }
  }
  out.points = made.size();
  if (made.size() < 20) return out;
  out.residual_px = std::sqrt(squares / sightings);
  const geo::Similarity fit = geo::similarityBetween(made, reference);
  const auto n = static_cast<Eigen::Index>(made.size());
  Eigen::MatrixXd form(n, 6);
  Eigen::VectorXd errors(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector3d& p = reference[static_cast<std::size_t>(i)];
    const Eigen::Vector2d u = (p - reference[0]).head<2>() / 100;
    form.row(i) << 1, u.x(), u.y(), u.x() * u.x(), u.x() * u.y(), u.y() * u.y();
    errors[i] = fit(made[static_cast<std::size_t>(i)]).z() - p.z();
  }
  out.height_rms_m = std::sqrt(errors.squaredNorm() / static_cast<double>(n));
  const Eigen::VectorXd dome = form.rightCols(3) * form.colPivHouseholderQr().solve(errors).tail(3);
  const Eigen::VectorXd plane = form.leftCols(3) * form.leftCols(3).colPivHouseholderQr().solve(dome);
  out.dome_rms_m = (dome - plane).norm() / std::sqrt(static_cast<double>(n));
  return out;
}

}  // namespace overfly::tests
