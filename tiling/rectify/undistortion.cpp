#include "tiling/rectify/undistortion.h"

#include <algorithm>
#include <cmath>

namespace overfly::tiling {
namespace {

using capture::CameraModel;
using Eigen::Vector2d;

constexpr int kCoarsestStep = 16;

// Position on the plane z = 1 of a source pixel; where the model ends before the pixel, of the last point
// towards it that is still good, seen from the principal point.
Vector2d tangentOf(const CameraModel& camera, const Vector2d& pixel, double limit) {
  const Vector2d centre(camera.cx, camera.cy);
  const auto tangent = [&](const Vector2d& at) -> std::optional<Vector2d> {
    const auto ray = camera.unproject(at);
    if (!ray || ray->z() <= 0 || ray->head<2>().norm() > limit * ray->z()) return std::nullopt;
    return Vector2d(ray->head<2>() / ray->z());
  };
  if (const auto all = tangent(pixel)) return *all;
  double good = 0, bad = 1;
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (good + bad);
    (tangent(centre + middle * (pixel - centre)) ? good : bad) = middle;
  }
  return tangent(centre + good * (pixel - centre)).value_or(Vector2d::Zero());
}

struct Bounds {
  Vector2d min = Vector2d::Constant(1e300);
  Vector2d max = Vector2d::Constant(-1e300);
  void add(const Vector2d& p) {
    min = min.cwiseMin(p);
    max = max.cwiseMax(p);
  }
};

// Of the source image's border on the plane z = 1.
Bounds borderOnPlane(const CameraModel& camera) {
  constexpr int kPoints = 64;        // a side
  constexpr double kFarthest = 1e3;  // tangent: all but at right angles to the axis
  Bounds out;
  for (int i = 0; i <= kPoints; ++i) {
    const double x = camera.width * static_cast<double>(i) / kPoints;
    const double y = camera.height * static_cast<double>(i) / kPoints;
    for (const Vector2d& pixel :
         {Vector2d(x, 0), Vector2d(x, camera.height), Vector2d(0, y), Vector2d(camera.width, y)}) {
      out.add(tangentOf(camera, pixel, kFarthest));
    }
  }
  return out;
}

int alignedUp(double size, int align) {
  // A hair over a whole number is the arithmetic's noise, not another pixel.
  return static_cast<int>(std::ceil((size - 1e-6) / align)) * align;
}

CameraModel pinholeFor(const CameraModel& camera, const UndistortionOptions& options) {
  const Bounds border = borderOnPlane(camera);
  double scale = 1;
  CameraModel out;
  out.kind = CameraModel::Kind::Pinhole;
  for (;;) {
    out.fx = camera.fx * scale;
    out.fy = camera.fy * scale;
    const auto side = [&](double low, double high, double f, double c, int size, double& centre) {
      const double reach_low = std::min(-low * f, options.max_growth * scale * c);
      const double reach_high = std::min(high * f, options.max_growth * scale * (size - c));
      // A whole number of pixels is added or cut off at the low side, so that an undistorted camera is
      // copied pixel by pixel.
      const double shift = std::floor(c * scale - reach_low + 1e-6);
      centre = c * scale - shift;
      return alignedUp(centre + reach_high, options.align);
    };
    out.width = side(border.min.x(), border.max.x(), out.fx, camera.cx, camera.width, out.cx);
    out.height = side(border.min.y(), border.max.y(), out.fy, camera.cy, camera.height, out.cy);
    const int longest = std::max(out.width, out.height);
    if (longest <= options.max_side) return out;
    scale *= static_cast<double>(options.max_side - options.align) / longest;
  }
}

void fillGrid(const CameraModel& camera, Undistortion& out) {
  out.nodes_x = (out.pinhole.width + out.step - 1) / out.step + 1;
  out.nodes_y = (out.pinhole.height + out.step - 1) / out.step + 1;
  out.shift.resize(static_cast<std::size_t>(out.nodes_x) * static_cast<std::size_t>(out.nodes_y) * 2);
  std::size_t at = 0;
  for (int j = 0; j < out.nodes_y; ++j) {
    for (int i = 0; i < out.nodes_x; ++i, at += 2) {
      const Vector2d pixel(i * out.step, j * out.step);
      const auto source = exactSourceFromPinhole(camera, out.pinhole, pixel);
      out.shift[at] = source ? static_cast<float>(source->x() - pixel.x()) : Undistortion::kNowhere;
      out.shift[at + 1] = source ? static_cast<float>(source->y() - pixel.y()) : Undistortion::kNowhere;
    }
  }
}

// Farthest distance between interpolated and exact map at the cells' centres, where bilinear interpolation
// of a smooth map errs most; only cells that meet the source image count.
double worstError(const CameraModel& camera, const Undistortion& map) {
  double worst = 0;
  const double half = 0.5 * map.step;
  for (double y = half; y < map.pinhole.height; y += map.step) {
    for (double x = half; x < map.pinhole.width; x += map.step) {
      const auto near = map.sourceFromPinhole({x, y});
      if (!near || near->x() < -map.step || near->y() < -map.step || near->x() > camera.width + map.step ||
          near->y() > camera.height + map.step) {
        continue;
      }
      const auto exact = exactSourceFromPinhole(camera, map.pinhole, {x, y});
      if (exact) worst = std::max(worst, (*near - *exact).norm());
    }
  }
  return worst;
}

}  // namespace

std::optional<Vector2d> exactSourceFromPinhole(const CameraModel& source, const CameraModel& pinhole,
                                               const Vector2d& pixel) {
  return source.project({(pixel.x() - pinhole.cx) / pinhole.fx, (pixel.y() - pinhole.cy) / pinhole.fy, 1.0});
}

std::optional<Vector2d> Undistortion::sourceFromPinhole(const Vector2d& pixel) const {
  const Vector2d g = pixel / step;
  const int i = static_cast<int>(std::floor(g.x())), j = static_cast<int>(std::floor(g.y()));
  if (i < 0 || j < 0 || i + 1 >= nodes_x || j + 1 >= nodes_y) return std::nullopt;
  const double fx = g.x() - i, fy = g.y() - j;
  Vector2d sum = Vector2d::Zero();
  for (int k = 0; k < 4; ++k) {
    const auto at = (static_cast<std::size_t>(j + k / 2) * static_cast<std::size_t>(nodes_x) +
                     static_cast<std::size_t>(i + k % 2)) *
                    2;
    if (shift[at] == kNowhere) return std::nullopt;
    sum += (k % 2 == 0 ? 1 - fx : fx) * (k / 2 == 0 ? 1 - fy : fy) * Vector2d(shift[at], shift[at + 1]);
  }
  return pixel + sum;
}

Result<Undistortion> planUndistortion(const CameraModel& source, const UndistortionOptions& options) {
  if (const auto problem = source.problem()) return fail(ErrorCode::BadInput, *problem);
  Undistortion out;
  out.pinhole = pinholeFor(source, options);
  for (out.step = kCoarsestStep;; out.step /= 2) {
    fillGrid(source, out);
    if (out.step == 1 || worstError(source, out) <= options.tolerance_px) return out;
  }
}

}  // namespace overfly::tiling
