#include "tests/unit/sweep/analytic_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace overfly::test {
namespace {

geo::TileFrame makeFrame() {
  const geo::TileLattice lattice = geo::TileLattice::webMercator();
  const auto plane = lattice.planeFromGeodetic(geo::radians(47.3769), geo::radians(8.5417));
  return {lattice, geo::TileLattice::keyAt(*plane, 20)};
}

std::array<double, 4> splineWeights(double f) {
  const double g = 1 - f;
  return {g * g * g / 6, (4 - 6 * f * f + 3 * f * f * f) / 6, (4 - 6 * g * g + 3 * g * g * g) / 6,
          f * f * f / 6};
}

}  // namespace

Pattern::Pattern(std::uint32_t seed, double cell_m) : cell_m_(cell_m) {
  std::mt19937 random(seed);
  for (std::vector<double>& octave : octave_)
    for (int i = 0; i < kSide * kSide; ++i)
      octave.push_back(static_cast<double>(random()) / static_cast<double>(std::mt19937::max()) * 2 - 1);
}

double Pattern::at(double x, double y) const {
  constexpr std::array<double, 3> kShare{0.55, 0.40, 0.30}, kScale{1.0, 2.7, 7.1};
  double value = 0.5;
  for (std::size_t o = 0; o < octave_.size(); ++o) {
    const double px = x / (cell_m_ * kScale[o]), py = y / (cell_m_ * kScale[o]);
    const double ix = std::floor(px), iy = std::floor(py);
    const std::array<double, 4> wx = splineWeights(px - ix), wy = splineWeights(py - iy);
    const auto cx = static_cast<std::int64_t>(ix), cy = static_cast<std::int64_t>(iy);
    for (int j = 0; j < 4; ++j)
      for (int i = 0; i < 4; ++i)
        value +=
            kShare[o] * wx[static_cast<std::size_t>(i)] * wy[static_cast<std::size_t>(j)] *
            octave_[o][static_cast<std::size_t>(((cy + j) & (kSide - 1)) * kSide + ((cx + i) & (kSide - 1)))];
  }
  return std::clamp(value, 0.0, 1.0);
}

double Scene::height(double east, double north) const {
  if (box && east >= box->west && east <= box->east && north >= box->south && north <= box->north)
    return box->roof_m;
  return ground(east, north);
}

Scene::Hit Scene::cast(const Eigen::Vector3d& eye, const Eigen::Vector3d& ray) const {
  // The ground by secant steps; exact at once where it is a plane.
  double t = (ground(0, 0) - eye.z()) / ray.z();
  double before_t = 0, before = eye.z() - ground(eye.x(), eye.y());
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector3d p = eye + t * ray;
    const double miss = p.z() - ground(p.x(), p.y());
    if (std::abs(miss) < 1e-9 || miss == before) break;
    const double next = t - miss * (t - before_t) / (miss - before);
    before_t = t;
    before = miss;
    t = next;
  }
  Hit hit{eye + t * ray, Surface::Ground};
  if (!box) return hit;
  const double roof = (box->roof_m - eye.z()) / ray.z();
  const Eigen::Vector3d on_roof = eye + roof * ray;
  if (roof < t && on_roof.x() >= box->west && on_roof.x() <= box->east && on_roof.y() >= box->south &&
      on_roof.y() <= box->north)
    return {on_roof, Surface::Roof};
  // A wall: the ray enters the box's column below its roof.
  double enter = -std::numeric_limits<double>::infinity(), leave = std::numeric_limits<double>::infinity();
  for (const auto& [low, high, axis] :
       {std::tuple{box->west, box->east, 0}, std::tuple{box->south, box->north, 1}}) {
    double a = (low - eye[axis]) / ray[axis], b = (high - eye[axis]) / ray[axis];
    if (a > b) std::swap(a, b);
    enter = std::max(enter, a);
    leave = std::min(leave, b);
  }
  if (enter > roof && enter < leave && enter < t) return {eye + enter * ray, Surface::Wall};
  return hit;
}

Eigen::Vector3d Scene::colour(const Hit& hit) const {
  if (hit.surface == Surface::Wall) return {1, 0, 1};
  const double shift = hit.surface == Surface::Roof ? 5.37 : 0;
  return Eigen::Vector3d::Constant(pattern.at(hit.point.x() + shift, hit.point.y() - shift));
}

const geo::TileFrame& sceneFrame() {
  static const geo::TileFrame frame = makeFrame();
  return frame;
}

capture::CameraModel sceneCamera(int size, double focal) {
  capture::CameraModel camera;
  camera.width = camera.height = size;
  camera.fx = camera.fy = focal;
  camera.cx = size / 2.0 + 1.3;  // a principal point off the centre shows mistakes of half pixels and sign
  camera.cy = size / 2.0 - 0.8;
  return camera;
}

capture::Pose lookDown(double east, double north, double height_m, double tilt_east, double tilt_north) {
  Eigen::Matrix3d enu_from_camera;
  enu_from_camera << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  enu_from_camera = Eigen::AngleAxisd(tilt_east, Eigen::Vector3d::UnitX()) *
                    Eigen::AngleAxisd(tilt_north, Eigen::Vector3d::UnitY()) * enu_from_camera;
  capture::Pose pose;
  pose.position_in_ecef = sceneFrame().local().ecefFromEnu({east, north, height_m});
  pose.ecef_from_camera =
      Eigen::Quaterniond(sceneFrame().local().enuFromEcefRotation().transpose() * enu_from_camera);
  return pose;
}

Photo takePhoto(const Scene& scene, const capture::CameraModel& camera, const capture::Pose& pose) {
  Photo photo{camera, pose, {}, {}};
  const Eigen::Matrix3d enu_from_camera =
      sceneFrame().local().enuFromEcefRotation() * pose.ecef_from_camera.toRotationMatrix();
  const Eigen::Vector3d eye = sceneFrame().local().enuFromEcef(pose.position_in_ecef);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (const double dy : {0.25, 0.75})
        for (const double dx : {0.25, 0.75}) {
          const Eigen::Vector3d in_camera((x + dx - camera.cx) / camera.fx, (y + dy - camera.cy) / camera.fy,
                                          1.0);
          sum += 0.25 * scene.colour(scene.cast(eye, enu_from_camera * in_camera));
        }
      for (int c = 0; c < 3; ++c)
        photo.rgba.push_back(static_cast<std::uint8_t>(std::lround(255 * std::clamp(sum[c], 0.0, 1.0))));
      photo.rgba.push_back(255);
      const double luma = 0.299 * sum.x() + 0.587 * sum.y() + 0.114 * sum.z();
      photo.luma.push_back(static_cast<std::uint8_t>(std::lround(255 * std::clamp(luma, 0.0, 1.0))));
    }
  return photo;
}

std::vector<Photo> takeNine(const Scene& scene, double tilt) {
  const capture::CameraModel camera = sceneCamera(520, kFlight / kGsd);
  std::vector<Photo> photos;
  for (int i = 0; i < 9; ++i) {
    const double east = 10.0 * (i % 3 - 1) + 0.37 * i, north = 10.0 * (i / 3 - 1) - 0.21 * i;
    photos.push_back(takePhoto(scene, camera,
                               lookDown(east, north, kGround + kFlight + 0.3 * i, tilt * std::sin(2.0 * i),
                                        tilt * std::cos(3.0 * i))));
  }
  return photos;
}

}  // namespace overfly::test
