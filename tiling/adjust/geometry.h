#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <span>
#include <vector>

// Closed-form geometry that gives the adjustment its first values. All image points are "normalised":
// undistorted, at unit focal length, (x/z, y/z) in camera axes. Reentrant and deterministic.
namespace overfly::tiling::adjust {

struct View {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Quaterniond world_from_camera = Eigen::Quaterniond::Identity();
};

// The point nearest to the rays of several views (least squares of the perpendicular distances, then two
// Gauss-Newton steps on the normalised re-projection). nullopt: parallel rays, or behind a camera.
[[nodiscard]] std::optional<Eigen::Vector3d> triangulate(std::span<const View> views,
                                                         std::span<const Eigen::Vector2d> normalised);

// Largest angle under which two of the views see the point, radians.
[[nodiscard]] double parallax(std::span<const View> views, const Eigen::Vector3d& point);

// Relative pose of two views of a scene that may be flat.
struct RelativePose {
  Eigen::Quaterniond a_from_b = Eigen::Quaterniond::Identity();
  Eigen::Vector3d b_in_a = Eigen::Vector3d::UnitX();  // unit length
  int inliers = 0;
  double median_parallax = 0;  // radians
};

struct RelativePoseHints {
  double tolerance = 0.002;                             // normalised re-projection distance of an inlier
  Eigen::Vector3d up_in_a = -Eigen::Vector3d::UnitZ();  // from the telemetry, to tell mirrored solutions of
  Eigen::Vector3d up_in_b = -Eigen::Vector3d::UnitZ();  // a plane apart
};

// Essential matrix (five points, RANSAC) and homography (four points, RANSAC), each decomposed; the
// candidate with most points in front of both cameras and within tolerance wins; near-ties (the two
// solutions of a plane) go to the one whose tilt change agrees with the hints. nullopt: fewer than 20.
[[nodiscard]] std::optional<RelativePose> relativePose(std::span<const Eigen::Vector2d> in_a,
                                                       std::span<const Eigen::Vector2d> in_b,
                                                       const RelativePoseHints& hints);

// Indices that one epipolar geometry or one plane explains (RANSAC); empty when fewer than `least`.
[[nodiscard]] std::vector<int> verifiedMatches(std::span<const Eigen::Vector2d> in_a,
                                               std::span<const Eigen::Vector2d> in_b, double tolerance,
                                               int least);

struct Resection {
  View view;
  std::vector<int> inliers;
};
// Camera pose from points seen (three-point RANSAC, then refined). nullopt: fewer than `least` agree.
[[nodiscard]] std::optional<Resection> resect(std::span<const Eigen::Vector3d> points,
                                              std::span<const Eigen::Vector2d> normalised, double tolerance,
                                              int least);

}  // namespace overfly::tiling::adjust
