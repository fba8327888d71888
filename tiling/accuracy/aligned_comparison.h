#pragma once
#include <Eigen/Core>
#include <map>
#include <span>

#include "capture/geo/geodetic.h"
#include "capture/geo/similarity.h"
#include "tiling/accuracy/accuracy.h"

namespace overfly::tiling {

// Heights of a map whose place, level and scale are not those of the reference, because its poses come from
// elsewhere. One half of the reference points (every second one) fits a similarity, the other half judges.
struct AlignedComparison {
  geo::Similarity map_from_reference;  // in the given local ENU
  std::size_t fitted_points = 0;
  ErrorStatistics strong, all;  // of the other half, after the similarity, in reference GSD
  // What a similarity does not take away: a quadratic surface through the errors of the other half (Huber),
  // less the plane that fits it best. Largest at the corners of the points' bounding box, and its RMS over
  // the points; GSD.
  double dome_corner = 0, dome_rms = 0;
  static constexpr double kDomeUnit = 100;         // metres
  Eigen::Vector3d dome = Eigen::Vector3d::Zero();  // of x^2, xy, y^2: GSD per kDomeUnit^2, x east, y north
  // Of x^2, xy, y^2 less their plane, in kDomeUnit^2: at the corner of dome_corner, and the mean of their
  // outer product over the points. With them a covariance of `dome` is one of dome_corner and dome_rms.
  Eigen::Vector3d corner_form = Eigen::Vector3d::Zero();
  Eigen::Matrix3d rms_form = Eigen::Matrix3d::Zero();
};

// `start`: map_from_reference to begin from, as between camera centres. Heights fit level and height freely;
// what flat ground does not show (place, heading, scale) stays near the start (1 m, 0.6 degrees, 0.5 %).
[[nodiscard]] AlignedComparison compareAligned(const std::map<geo::TileKey, Tile>& tiles,
                                               const geo::TileLattice& lattice, int zoom, double anchor_px,
                                               std::span<const ReferencePoint> points,
                                               const geo::LocalFrame& local, double gsd_m,
                                               const geo::Similarity& start);

}  // namespace overfly::tiling
