#pragma once
#include <cstdint>
#include <vector>

#include "capture/camera_model.h"
#include "render/scene/appearance.h"
#include "render/scene/flight_path.h"
#include "render/scene/geometry.h"

namespace overfly::scene {

struct TraceOptions {
  bool shadows = false;
  int samples = 4;         // 1, or 4: the rasteriser's sample places
  double line_time_s = 0;  // rolling shutter: rows after the middle one see later states
};

// RGB, three bytes a pixel, rows from the top without gaps.
struct Picture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;
};

// Colour of what a ray sees: shaded as the rasteriser does. `width` is the footprint's side in metres.
struct Shader {
  const Geometry& geometry;
  const Appearance& appearance;
  bool shadows = false;

  // Encoded colour of a hit at a point in its plane, filtered over the footprint spanned by dx and dy.
  [[nodiscard]] glsl::vec3 colour(const Hit& hit, const Eigen::Vector3d& point, const Eigen::Vector3d& dx,
                                  const Eigen::Vector3d& dy) const;
};

// The second way to make a frame: rays through pixels against the exact geometry, in double on the CPU. Slow
// (about a microsecond a ray); for small pictures and for judging the rasteriser. The lens is the camera's
// own, distortion included.
[[nodiscard]] Picture tracePicture(const Geometry& geometry, const capture::CameraModel& camera,
                                   const FlightPath& path, double time_s, const TraceOptions& options = {});
[[nodiscard]] Picture tracePicture(const Geometry& geometry, const capture::CameraModel& camera,
                                   const CameraState& state, const TraceOptions& options = {});

// Depth along the camera's axis of each pixel's centre, metres; 0 where nothing is seen. Exact.
[[nodiscard]] std::vector<double> traceDepth(const Geometry& geometry, const capture::CameraModel& camera,
                                             const CameraState& state);

}  // namespace overfly::scene
