#pragma once
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cmath>

#include "capture/geo/geodetic.h"
#include "tiling/index/frame_index.h"

// Frames over any place of the Earth for the tests of this folder.
namespace overfly::tiling::testing {

inline capture::CameraModel camera() {
  capture::CameraModel model;
  model.width = 4000;
  model.height = 3000;
  model.fx = model.fy = 3000;
  model.cx = 2000;
  model.cy = 1500;
  return model;
}

inline rc::Gen<double> uniform(double low, double high) {
  constexpr std::int64_t kSteps = std::int64_t{1} << 40;
  return rc::gen::map(rc::gen::resize(rc::kNominalSize, rc::gen::inRange<std::int64_t>(0, kSteps + 1)),
                      [=](std::int64_t k) {
                        return low + (high - low) * (static_cast<double>(k) / static_cast<double>(kSteps));
                      });
}

// A map somewhere: its lattice, the place around which frames lie, and its anchor.
struct Site {
  geo::TileLattice lattice = geo::TileLattice::webMercator();
  geo::Geodetic centre;  // on the assumed ground
  double anchor_px = 0.5;
};

inline Site siteAt(const geo::TileLattice& lattice, double lat_deg, double lon_deg, double ground_m = 400) {
  Site site{lattice, {geo::radians(lat_deg), geo::radians(lon_deg), ground_m}, 0.5};
  site.anchor_px = lattice.planeFromGeodetic(site.centre.lat, site.centre.lon)->x();
  return site;
}

// Ordinary, on the antimeridian (both signs), at a pole.
inline std::vector<Site> sites() {
  return {siteAt(geo::TileLattice::webMercator(), 48.4, 9.99),
          siteAt(geo::TileLattice::webMercator(), -16.5, 180),
          siteAt(geo::TileLattice::webMercator(), 65.1, -179.9999),
          siteAt(geo::TileLattice::ups(false), -90, 0, 2800),
          siteAt(geo::TileLattice::utm(33, true).value(), 0, 15)};
}

// A frame `east`, `north` metres from the site's centre, `above` metres over its ground.
inline IndexedFrame frame(const Site& site, std::uint64_t id, double east, double north, double above,
                          double yaw_deg = 0, double pitch_deg = -90, double roll_deg = 0,
                          double sharpness = 0) {
  const geo::LocalFrame local(site.centre);
  const geo::Geodetic at = geo::geodeticFromEcef(local.ecefFromEnu({east, north, above}));
  const geo::LocalFrame there(at);
  capture::Pose pose;
  pose.position_in_ecef = geo::ecefFromGeodetic(at);
  pose.ecef_from_camera =
      Eigen::Quaterniond(Eigen::Matrix3d(there.enuFromEcefRotation().transpose())) *
      geo::enuFromCamera(geo::radians(yaw_deg), geo::radians(pitch_deg), geo::radians(roll_deg));
  return makeIndexedFrame(id, camera(), pose, sharpness, site.lattice, site.anchor_px, site.centre.height_m)
      .value();
}

inline rc::Gen<IndexedFrame> anyFrame(const Site& site, std::uint64_t id) {
  return rc::gen::map(rc::gen::tuple(uniform(-500, 500), uniform(-500, 500), uniform(20, 200),
                                     uniform(-180, 180), uniform(-90, -40), uniform(-20, 20)),
                      [=](const std::tuple<double, double, double, double, double, double>& t) {
                        return frame(site, id, std::get<0>(t), std::get<1>(t), std::get<2>(t), std::get<3>(t),
                                     std::get<4>(t), std::get<5>(t));
                      });
}

inline std::vector<std::uint64_t> ids(const std::vector<const IndexedFrame*>& frames) {
  std::vector<std::uint64_t> result;
  for (const IndexedFrame* f : frames) result.push_back(f->id);
  return result;
}

}  // namespace overfly::tiling::testing
