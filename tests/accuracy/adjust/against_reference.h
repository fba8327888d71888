#pragma once
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "capture/geo/similarity.h"
#include "tiling/adjust/bundle.h"

// Poses against a reference's, after the similarity between their camera centres.
namespace overfly::tests {

struct AgainstReference {
  geo::Similarity similarity;  // reference from poses
  double position_rms_m = 0, worst_position_m = 0;
  double rotation_rms_deg = 0;  // after the similarity's turn
};

// Centres and attitudes (camera axes into the poses' own frame, and into the reference's ENU) by index; at
// least three. `verbose` prints each difference.
inline AgainstReference againstReference(const std::vector<Eigen::Vector3d>& positions,
                                         const std::vector<Eigen::Quaterniond>& attitudes,
                                         const std::vector<Eigen::Vector3d>& wanted,
                                         const std::vector<Eigen::Quaterniond>& wanted_attitudes,
                                         bool verbose) {
  AgainstReference out;
  out.similarity = geo::similarityBetween(positions, wanted);
  double position2 = 0, rotation2 = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const Eigen::Vector3d off = out.similarity(positions[i]) - wanted[i];
    const Eigen::Vector3d turned =
        57.29578 * tiling::adjust::rotationVector(Eigen::Quaterniond(out.similarity.turn) * attitudes[i] *
                                                  wanted_attitudes[i].conjugate());
    position2 += off.squaredNorm();
    rotation2 += turned.squaredNorm();
    out.worst_position_m = std::max(out.worst_position_m, off.norm());
    if (verbose)
      fmt::print("  {} off by {:.3f} {:.3f} {:.3f} m, {:.3f} {:.3f} {:.3f} deg\n", i, off.x(), off.y(),
                 off.z(), turned.x(), turned.y(), turned.z());
  }
  const auto n = static_cast<double>(positions.size());
  out.position_rms_m = std::sqrt(position2 / n);
  out.rotation_rms_deg = std::sqrt(rotation2 / n);
  return out;
}

}  // namespace overfly::tests
