#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "capture/camera_model.h"
#include "config/error.h"
#include "render/preview/view.h"

namespace overfly::preview {

// A photograph that is thrown back onto the surface from where it was taken (thesis, 6.2). Its position is
// meant in the same heights as the map's.
struct Projector {
  std::uint64_t id = 0;  // of one photograph for ever
  Eigen::Vector3d position_in_ecef = Eigen::Vector3d::Zero();
  Eigen::Quaterniond ecef_from_camera = Eigen::Quaterniond::Identity();
};

// Its picture without distortion. Pixels need not be square.
struct ProjectorImage {
  capture::CameraModel pinhole;
  std::vector<std::uint8_t> rgba;  // row 0 at the top; alpha 0 where the photograph does not reach
};

struct ProjectorQuery {
  View view;
  double far_m = 1000;            // how far the view sees
  int count = 8;                  // N of 6.2.1
  double max_angle = 0.78539816;  // between the viewing directions, radians (Phi max)
};

// All that the preview knows of photographs. Thread rule: that of its implementation; called by the view's
// thread.
class ProjectorSource {
 public:
  virtual ~ProjectorSource() = default;
  // At most `count` photographs that suit a view, nearest to it first; without those whose picture could not
  // be had before.
  [[nodiscard]] virtual Result<std::vector<Projector>> choose(const ProjectorQuery& query) = 0;
  // The picture of one of them, brought to this many pixels. Unavailable: it is being read; ask again.
  [[nodiscard]] virtual Result<ProjectorImage> load(std::uint64_t id, int width, int height) = 0;
};

}  // namespace overfly::preview
