#pragma once
// Scenes in closed form and their photographs by exact ray casting in double on the CPU. Shares nothing with
// the sweep: only camera and pose values and the Earth's geometry.
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "capture/camera_model.h"
#include "capture/geo/tile_frame.h"
#include "capture/pose.h"

namespace overfly::test {

// A smooth random pattern, 0..1, periodic: octaves of cubic B-splines over random lattices.
class Pattern {
 public:
  // `cell_m`: spacing of the finest lattice; no wavelength shorter than about twice that.
  Pattern(std::uint32_t seed, double cell_m);
  [[nodiscard]] double at(double x, double y) const;

 private:
  static constexpr int kSide = 64;
  double cell_m_;
  std::array<std::vector<double>, 3> octave_;
};

// Metres in the ENU frame of the cell's centre.
struct Box {
  double west = 0, south = 0, east = 0, north = 0;
  double roof_m = 0;  // ellipsoidal
};

struct Scene {
  std::function<double(double east, double north)> ground;  // ellipsoidal height; slopes below 0.4
  std::optional<Box> box;
  Pattern pattern{1, 0.25};

  enum class Surface { Ground, Roof, Wall };
  struct Hit {
    Eigen::Vector3d point;
    Surface surface;
  };
  // First surface along a ray that points downwards.
  [[nodiscard]] Hit cast(const Eigen::Vector3d& eye, const Eigen::Vector3d& ray) const;
  // Grey pattern; walls are magenta.
  [[nodiscard]] Eigen::Vector3d colour(const Hit& hit) const;
  [[nodiscard]] double height(double east, double north) const;
};

struct Photo {
  capture::CameraModel camera;
  capture::Pose pose;
  std::vector<std::uint8_t> rgba, luma;
};

// The cell all scenes stand in: Zurich, 256 texels of 0.10 m.
[[nodiscard]] const geo::TileFrame& sceneFrame();
inline constexpr double kGround = 455;  // ellipsoidal, metres
inline constexpr double kFlight = 60;   // metres above it
inline constexpr double kGsd = 0.1;

[[nodiscard]] capture::CameraModel sceneCamera(int size, double focal);
// At (east, north) and `height_m` (ellipsoidal), looking down, tilted (rad) around the east and north axes.
[[nodiscard]] capture::Pose lookDown(double east, double north, double height_m, double tilt_east = 0,
                                     double tilt_north = 0);
[[nodiscard]] Photo takePhoto(const Scene& scene, const capture::CameraModel& camera,
                              const capture::Pose& pose);
// Nine cameras, 3 x 3, 10 m apart, 60 m up, 520 x 520 pixels; tilted by up to `tilt` each in its own way.
[[nodiscard]] std::vector<Photo> takeNine(const Scene& scene, double tilt = 0);

}  // namespace overfly::test
