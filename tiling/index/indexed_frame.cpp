#include "tiling/index/indexed_frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "capture/geo/geodetic.h"

namespace overfly::tiling {

std::array<Eigen::Vector2d, 4> IndexedFrame::footprintAt(double height_m) const {
  const double scale =
      std::max(0.0, (camera_height_m - height_m) / std::max(camera_height_m - ground_height_m, 1e-9));
  std::array<Eigen::Vector2d, 4> corners;
  for (std::size_t i = 0; i < 4; ++i) corners[i] = nadir + scale * (footprint[i] - nadir);
  return corners;
}

Result<IndexedFrame> makeIndexedFrame(std::uint64_t id, const capture::CameraModel& camera,
                                      const capture::Pose& pose, double sharpness,
                                      const geo::TileLattice& lattice, double anchor_px,
                                      double ground_height_m, const IndexedFrameOptions& options) {
  if (const auto problem = camera.problem())
    return fail(ErrorCode::BadInput, fmt::format("frame {}: {}", id, *problem));
  if (!pose.position_in_ecef.allFinite() || !pose.ecef_from_camera.coeffs().allFinite() ||
      !(pose.ecef_from_camera.norm() > 0.5) || !(pose.position_in_ecef.norm() > 1e6))
    return fail(ErrorCode::BadInput, fmt::format("frame {}: its pose is not a place on Earth", id));

  IndexedFrame record;
  record.id = id;
  record.camera = camera;
  record.pose = pose;
  record.sharpness = sharpness;
  double depth_m = options.oblique_depth_m;
  const auto print = geo::footprint(camera, pose, ground_height_m, options.footprint);
  if (print && print->tilt <= options.max_tilt) {
    const geo::Geodetic at = geo::geodeticFromEcef(pose.position_in_ecef);
    const auto nadir = lattice.planeFromGeodetic(at.lat, at.lon, anchor_px);
    const Eigen::Vector3d axis = pose.ecef_from_camera.normalized() * Eigen::Vector3d::UnitZ();
    record.near_vertical = nadir.has_value();
    double reach_m = 0;
    for (std::size_t i = 0; i < 4 && record.near_vertical; ++i) {
      const auto corner = lattice.planeFromGeodetic(print->corners[i].lat, print->corners[i].lon, nadir->x());
      if (!corner) {
        record.near_vertical = false;
        break;
      }
      record.footprint[i] = *corner;
      reach_m = std::max(reach_m, axis.dot(geo::ecefFromGeodetic(print->corners[i]) - pose.position_in_ecef));
    }
    if (record.near_vertical) {
      record.nadir = *nadir;
      record.ground_height_m = ground_height_m;
      record.camera_height_m = at.height_m;
      record.gsd_m = print->gsd_m;
      record.tilt = print->tilt;
      depth_m = reach_m;
    }
  }
  record.base_in_ecef = geo::viewPyramidBase(camera, pose, depth_m);
  record.pyramid_in_ecef = geo::viewPyramidBox(camera, pose, depth_m);
  return record;
}

}  // namespace overfly::tiling
