#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "capture/camera_model.h"
#include "capture/geo/footprint.h"
#include "capture/geo/tile_lattice.h"
#include "capture/pose.h"
#include "config/error.h"

namespace overfly::tiling {

// What the index and the view selection know about one frame: its place, no pixels. Value type.
struct IndexedFrame {
  std::uint64_t id = 0;  // unique within a map; also the order of every result
  capture::CameraModel camera;
  capture::Pose pose;
  std::int64_t utc_ns = 0;  // middle of the exposure
  double sharpness = 0;     // any measure that grows with sharpness, comparable within a flight; 0: unknown

  // The view pyramid's base in ECEF (3.2.3), perpendicular to the view; for a near-vertical frame just deep
  // enough that the whole footprint lies before it, else at a set depth. Corners top-left, top-right,
  // bottom-right, bottom-left of the image.
  std::array<Eigen::Vector3d, 4> base_in_ecef;
  geo::Box3 pyramid_in_ecef;  // of apex and base

  // Near-vertical: has a footprint and looks down steeply enough to contribute to tiles (3.2.4). What follows
  // is set only then.
  bool near_vertical = false;
  std::array<Eigen::Vector2d, 4> footprint;  // lattice plane coordinates, px unwrapped near the map's anchor
  Eigen::Vector2d nadir = Eigen::Vector2d::Zero();  // the point below the camera, likewise
  double ground_height_m = 0;  // ellipsoidal height of the surface that the footprint lies on
  double camera_height_m = 0;  // ellipsoidal
  double gsd_m = 0;            // at the principal point
  double tilt = 0;             // of the view from straight down, radians

  // The footprint as it would be on a surface at another height: scaled about the nadir point. Exact for a
  // flat Earth; at 500 m above ground the neglected curvature is below 2 cm over a footprint of 500 m.
  // Empty area (all corners at the nadir) when the surface is not below the camera.
  [[nodiscard]] std::array<Eigen::Vector2d, 4> footprintAt(double height_m) const;
};

struct IndexedFrameOptions {
  double max_tilt = 0.61;  // radians (35 deg): steeper frames make tiles, flatter ones are only indexed
  double oblique_depth_m = 1000;  // length of the view pyramid of a frame that does not meet the ground
  geo::FootprintLimits footprint;
};

// Derives everything from camera, pose and the ground's ellipsoidal height (the map's, or take-off's).
// `anchor_px` is the map's: px of its first frame, so that a map across the antimeridian has one range.
// BadInput for a camera or pose that is unusable; an oblique frame is no error.
[[nodiscard]] Result<IndexedFrame> makeIndexedFrame(std::uint64_t id, const capture::CameraModel& camera,
                                                    const capture::Pose& pose, double sharpness,
                                                    const geo::TileLattice& lattice, double anchor_px,
                                                    double ground_height_m,
                                                    const IndexedFrameOptions& options = {});

}  // namespace overfly::tiling
