#include "tiling/sweep/detail/view_geometry.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace overfly::tiling {

ViewGeometry viewGeometry(std::span<const SweepView> views, const geo::TileFrame& frame,
                          double ground_height_m, double reference_height_m) {
  ViewGeometry geometry;
  const double reference = reference_height_m;
  geometry.reference_height_m = reference;
  for (std::size_t i = 0; i < geometry.ground.size(); ++i) {
    Eigen::Vector3d value = frame.ground()[i];
    if (i < frame.up().size()) value += reference * frame.up()[i];
    geometry.ground[i] = value.cast<float>();
  }
  for (std::size_t i = 0; i < geometry.up.size(); ++i) geometry.up[i] = frame.up()[i].cast<float>();

  double mean_height = 0;
  std::vector<Eigen::Vector3d> centres;
  for (const SweepView& view : views) {
    const Eigen::Vector3d centre = frame.local().enuFromEcef(view.pose.position_in_ecef);
    centres.push_back(centre);
    mean_height += centre.z() / static_cast<double>(views.size());
    const Eigen::Matrix3d camera_from_tile =
        view.pose.ecef_from_camera.normalized().toRotationMatrix().transpose() *
        frame.local().enuFromEcefRotation().transpose();
    Eigen::Matrix3d image_from_camera = Eigen::Matrix3d::Identity();
    const capture::CameraModel& camera = view.camera;
    image_from_camera(0, 0) = camera.fx / camera.width;
    image_from_camera(0, 2) = camera.cx / camera.width;
    image_from_camera(1, 1) = camera.fy / camera.height;
    image_from_camera(1, 2) = camera.cy / camera.height;
    const Eigen::Matrix3d rotation = image_from_camera * camera_from_tile;
    const Eigen::Vector3d offset = -rotation * centre;
    for (int row = 0; row < 3; ++row)
      geometry.matrix.emplace_back(
          Eigen::Vector4d(rotation(row, 0), rotation(row, 1), rotation(row, 2), offset(row)).cast<float>());
  }
  double baseline = 0;
  int pairs = 0;
  for (std::size_t i = 0; i < centres.size(); ++i)
    for (std::size_t j = 0; j < i; ++j, ++pairs) baseline += (centres[i] - centres[j]).head<2>().norm();
  baseline /= std::max(pairs, 1);
  for (std::size_t k = 0; k < views.size(); ++k) {
    geometry.view_gsd_m.push_back(std::max(centres[k].z() - ground_height_m, 0.1) / views[k].camera.fx);
    geometry.camera.push_back(centres[k].cast<float>());
  }
  std::vector<double> gsd = geometry.view_gsd_m;
  std::nth_element(gsd.begin(), gsd.begin() + static_cast<std::ptrdiff_t>(gsd.size() / 2), gsd.end());
  geometry.gsd_m = gsd[gsd.size() / 2];
  const double depth = std::max(mean_height - ground_height_m, 0.1);
  geometry.height_per_baseline = std::clamp(depth / std::max(baseline, 1e-6), 0.3, 50.0);
  return geometry;
}

std::vector<gl::Define> viewDefines(int views) {
  std::string each;
  std::string pairs;
  for (int k = 0; k < views; ++k) {
    each += "F(" + std::to_string(k) + ") ";
    for (int j = 0; j < k; ++j) pairs += "F(" + std::to_string(k) + ", " + std::to_string(j) + ") ";
  }
  return {{"VIEWS", std::to_string(views)}, {"EACH_VIEW(F)", each}, {"EACH_PAIR(F)", pairs}};
}

void setGrid(gl::Program& program, const ViewGeometry& geometry, int texels, int apron) {
  const float step = 2.0f / static_cast<float>(texels);
  const float origin = -1.0f - static_cast<float>(apron) * step;
  program.set("grid_origin", Eigen::Vector2f(origin, origin));
  program.set("grid_step", step);
  program.set("ground", std::span<const Eigen::Vector3f>(geometry.ground));
  program.set("up", std::span<const Eigen::Vector3f>(geometry.up));
}

void setRays(gl::Program& program, const ViewGeometry& geometry, std::span<const SweepView> views, int texels,
             int apron) {
  setGrid(program, geometry, texels, apron);
  program.set("view_matrix", std::span<const Eigen::Vector4f>(geometry.matrix));
  for (std::size_t k = 0; k < views.size(); ++k)
    if (views[k].match != nullptr)
      program.setTexture("views[" + std::to_string(k) + "]", static_cast<int>(k) + 1, *views[k].match);
}

}  // namespace overfly::tiling
