#pragma once
// Scenes that stand in the East-North-Up frame of a tile, photographed once by exact ray casting in double,
// and then put anywhere on Earth: the pictures stay, only the poses change.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <memory>
#include <stdexcept>
#include <vector>

#include "tests/unit/gl/gl_fixture.h"
#include "tests/unit/sweep/gpu_photos.h"
#include "tiling/sweep/sweep.h"

namespace overfly::test {

// Where a camera stands in scene coordinates: ENU metres, z above the scene's ground at 0.
struct Station {
  Eigen::Vector3d eye = Eigen::Vector3d::Zero();
  Eigen::Matrix3d enu_from_camera = Eigen::Matrix3d::Identity();
};

// Straight down, the picture's top to the north.
[[nodiscard]] inline Station straightDown(double east, double north, double up) {
  Station station{{east, north, up}, {}};
  station.enu_from_camera << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  return station;
}
// From a place, so that a target lies in the middle of the picture.
[[nodiscard]] inline Station lookingAt(const Eigen::Vector3d& eye, const Eigen::Vector3d& target) {
  const Eigen::Vector3d z = (target - eye).normalized();
  const Eigen::Vector3d x = (Eigen::Vector3d::UnitX() - z * z.x()).normalized();
  Station station{eye, {}};
  station.enu_from_camera.col(0) = x;
  station.enu_from_camera.col(1) = z.cross(x);
  station.enu_from_camera.col(2) = z;
  return station;
}

struct PlacedPhoto {
  Station station;
  Photo photo;  // its pose is that of the last place
};

// What a ray from a place sees: grey, 0..1.
using Look = std::function<double(const Eigen::Vector3d& eye, const Eigen::Vector3d& ray)>;
[[nodiscard]] inline Look lookOf(const Scene& scene) {
  return [scene](const Eigen::Vector3d& eye, const Eigen::Vector3d& ray) {
    return scene.colour(scene.cast(eye, ray)).x();
  };
}

[[nodiscard]] inline PlacedPhoto photograph(const Look& look, const capture::CameraModel& camera,
                                            const Station& station) {
  PlacedPhoto placed{station, {camera, {}, {}, {}}};
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      double sum = 0;
      for (const double dy : {0.25, 0.75})
        for (const double dx : {0.25, 0.75})
          sum += 0.25 * look(station.eye, station.enu_from_camera *
                                              Eigen::Vector3d((x + dx - camera.cx) / camera.fx,
                                                              (y + dy - camera.cy) / camera.fy, 1.0));
      const auto grey = static_cast<std::uint8_t>(std::lround(255 * std::clamp(sum, 0.0, 1.0)));
      placed.photo.luma.push_back(grey);
      placed.photo.rgba.insert(placed.photo.rgba.end(), {grey, grey, grey, 255});
    }
  return placed;
}

// A station in the frame of a tile: scene coordinates scaled by `stretch`, raised to `height_m` and, where
// the lattice's rows do not run west to east, turned by `azimuth` (radians, counter-clockwise).
[[nodiscard]] inline capture::Pose poseAt(const Station& station, const geo::LocalFrame& tile,
                                          double height_m, double stretch = 1, double azimuth = 0) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(azimuth, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  capture::Pose pose;
  pose.position_in_ecef = tile.ecefFromEnu(stretch * (turn * station.eye) + Eigen::Vector3d(0, 0, height_m));
  pose.ecef_from_camera = Eigen::Quaterniond(
      Eigen::Matrix3d(tile.enuFromEcefRotation().transpose() * turn * station.enu_from_camera));
  return pose;
}

// Gentle hills with texture at every scale down to 0.8 m, around height 0.
[[nodiscard]] inline Scene hills(std::uint32_t seed = 8) {
  return {
      [](double east, double north) { return 0.6 * std::sin(0.31 * east) * std::cos(0.27 * north + 0.4); },
      {},
      Pattern(seed, 0.8)};
}
[[nodiscard]] inline Scene flat(std::uint32_t seed = 8) {
  return {[](double, double) { return 0.0; }, {}, Pattern(seed, 0.8)};
}

// Five cameras 60 m up, 9 and 7 m apart, 220 x 220 pixels of 0.25 m on the ground.
inline constexpr double kUp = 60, kFocal = 240, kPixel = kUp / kFocal;
[[nodiscard]] inline std::vector<Station> fiveStations() {
  std::vector<Station> stations;
  for (int i = 0; i < 5; ++i)
    stations.push_back(straightDown(9.0 * (i % 3) - 9, 7.0 * (i / 3) - 5, kUp + 0.2 * i));
  return stations;
}
[[nodiscard]] inline std::vector<PlacedPhoto> photographs(const Look& look,
                                                          const std::vector<Station>& stations,
                                                          const capture::CameraModel& camera) {
  std::vector<PlacedPhoto> photos;
  for (const Station& station : stations) photos.push_back(photograph(look, camera, station));
  return photos;
}
[[nodiscard]] inline std::vector<PlacedPhoto> fivePhotos(const Look& look) {
  return photographs(look, fiveStations(), sceneCamera(220, kFocal));
}

// A tile with the scene's origin at its centre; 64 texels of about 0.3 m.
inline constexpr int kTexels = 64, kApron = 8, kZoom = 21;
[[nodiscard]] inline geo::TileFrame localTile(double lat, double lon) {
  return {geo::TileLattice::local({lat, lon, 0}), {kZoom, 0, 0}};
}

// Height of the scene's ground level and the range that is searched.
[[nodiscard]] inline tiling::SweepGrid gridOf(const geo::TileFrame& frame, double height_m,
                                              double stretch = 1, double below = 12, double above = 25) {
  return {&frame, kTexels, kApron, height_m, height_m - stretch * below, height_m + stretch * above};
}

// Photographs on the GPU that can be put anywhere.
class PlacedViews {
 public:
  PlacedViews(gl::Context& context, std::vector<PlacedPhoto> photos)
      : stations_(stationsOf(photos)), gpu_(context, onlyPhotos(photos)) {}

  [[nodiscard]] std::vector<tiling::SweepView> at(const geo::LocalFrame& tile, double height_m,
                                                  double stretch = 1, bool luma = false,
                                                  double azimuth = 0) const {
    std::vector<tiling::SweepView> views = gpu_.sweepViews(luma);
    for (std::size_t i = 0; i < views.size(); ++i)
      views[i].pose = poseAt(stations_[i], tile, height_m, stretch, azimuth);
    return views;
  }
  [[nodiscard]] std::vector<tiling::OrthoView> orthoAt(const geo::LocalFrame& tile, double height_m,
                                                       double stretch = 1, double azimuth = 0) const {
    std::vector<tiling::OrthoView> views = gpu_.orthoViews();
    for (std::size_t i = 0; i < views.size(); ++i)
      views[i].pose = poseAt(stations_[i], tile, height_m, stretch, azimuth);
    return views;
  }

 private:
  static std::vector<Station> stationsOf(const std::vector<PlacedPhoto>& photos) {
    std::vector<Station> stations;
    for (const PlacedPhoto& photo : photos) stations.push_back(photo.station);
    return stations;
  }
  static std::vector<Photo> onlyPhotos(const std::vector<PlacedPhoto>& photos) {
    std::vector<Photo> only;
    for (const PlacedPhoto& photo : photos) only.push_back(photo.photo);
    return only;
  }
  std::vector<Station> stations_;
  GpuPhotos gpu_;
};

[[nodiscard]] inline tiling::HeightField sweepOf(gl::Context& context, const tiling::SweepGrid& grid,
                                                 const std::vector<tiling::SweepView>& views,
                                                 const tiling::SweepOptions& options = {}) {
  auto sweeper = tiling::Sweeper::create(context);
  if (!sweeper) throw std::runtime_error(sweeper.error().message);
  auto field = (*sweeper)->run(grid, views, options);
  if (!field) throw std::runtime_error(field.error().message);
  return std::move(*field);
}

// The confidence from which a height is believed (config::Sweep::min_confidence), as the field codes it.
inline constexpr std::uint8_t kConfident = 51;

// Errors of the texels of the cell (without apron): measured minus truth, in scene metres. `truth` takes
// scene coordinates (east, north).
struct FieldErrors {
  std::vector<double> all;
  std::vector<double> confident;
  std::size_t texels = 0;

  [[nodiscard]] static double rms(const std::vector<double>& errors) {
    double squares = 0;
    for (const double e : errors) squares += e * e;
    return std::sqrt(squares / static_cast<double>(std::max<std::size_t>(errors.size(), 1)));
  }
  // Share of all texels whose height is believed and off by more than `bound`.
  [[nodiscard]] double confidentWrong(double bound) const {
    std::size_t wrong = 0;
    for (const double e : confident) wrong += std::abs(e) > bound ? 1 : 0;
    return static_cast<double>(wrong) / static_cast<double>(texels);
  }
  [[nodiscard]] double complete() const {
    return static_cast<double>(all.size()) / static_cast<double>(texels);
  }
};
[[nodiscard]] inline FieldErrors errorsOf(const tiling::HeightField& field, const geo::TileFrame& frame,
                                          const std::function<double(double, double)>& truth, double height_m,
                                          double stretch = 1) {
  FieldErrors errors;
  for (int y = field.apron; y < field.apron + field.texels; ++y)
    for (int x = field.apron; x < field.apron + field.texels; ++x) {
      ++errors.texels;
      const auto i = static_cast<std::size_t>(y * field.side() + x);
      if (std::isnan(field.height[i])) continue;
      const Eigen::Vector3d p = frame.enuFromTexelExact((x - field.apron + 0.5) / field.texels,
                                                        (y - field.apron + 0.5) / field.texels, height_m);
      const double z = (static_cast<double>(field.height[i]) - height_m) / stretch;
      const double error = z - truth(p.x() / stretch, p.y() / stretch);
      errors.all.push_back(error);
      if (field.confidence[i] >= kConfident) errors.confident.push_back(error);
    }
  return errors;
}

// A count that the environment may raise: short in CI, long where there is time.
[[nodiscard]] inline int countFrom(const char* variable, int standard) {
  const char* text = std::getenv(variable);
  return text != nullptr && std::atoi(text) > 0 ? std::atoi(text) : standard;
}

}  // namespace overfly::test
