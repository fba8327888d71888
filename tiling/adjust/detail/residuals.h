#pragma once
#include <ceres/rotation.h>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "capture/camera_model.h"
#include "tiling/adjust/bundle.h"

// The residuals of the adjustment, as Ceres auto-differentiates them. Quaternions are stored in Eigen's
// order (x, y, z, w); poses are enu_from_camera.
namespace overfly::tiling::adjust::detail {

// Constant part of a lens: its kind, aspect ratio and the rational coefficients k4..k6 that stay.
struct LensForm {
  capture::CameraModel::Kind kind = capture::CameraModel::Kind::Pinhole;
  double aspect = 1;
  std::array<double, 3> rational{0, 0, 0};

  explicit LensForm(const capture::CameraModel& model) : kind(model.kind), aspect(model.fy / model.fx) {
    for (std::size_t i = 0; i < 3 && model.distortion.size() == 8; ++i) rational[i] = model.distortion[5 + i];
  }
};

// Pixel of a point in camera axes. OpenCV's radial-tangential (with rational denominator) or fisheye model.
// False behind the camera.
template <class T>
bool project(const LensForm& form, const T* lens, const Eigen::Matrix<T, 3, 1>& p,
             Eigen::Matrix<T, 2, 1>& px) {
  const T *f = lens, *c = lens + 1, *d = lens + 3;
  if (form.kind == capture::CameraModel::Kind::Fisheye) {
    const T r2 = p.x() * p.x() + p.y() * p.y();
    if (r2 < T(1e-24)) {
      if (p.z() <= T(0)) return false;
      px = {f[0] * p.x() / p.z() + c[0], f[0] * form.aspect * p.y() / p.z() + c[1]};
      return true;
    }
    using std::atan2;
    using std::sqrt;
    const T r = sqrt(r2), a = atan2(r, p.z()), a2 = a * a;
    const T scale = a * (T(1) + a2 * (d[0] + a2 * (d[1] + a2 * (d[2] + a2 * d[3])))) / r;
    px = {f[0] * scale * p.x() + c[0], f[0] * form.aspect * scale * p.y() + c[1]};
    return true;
  }
  if (p.z() <= T(1e-6)) return false;
  const T x = p.x() / p.z(), y = p.y() / p.z(), r2 = x * x + y * y;
  T radial = T(1) + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
  const auto& q = form.rational;
  if (q[0] != 0 || q[1] != 0 || q[2] != 0) radial /= T(1) + r2 * (q[0] + r2 * (q[1] + r2 * q[2]));
  const T xd = x * radial + T(2) * d[2] * x * y + d[3] * (r2 + T(2) * x * x);
  const T yd = y * radial + d[2] * (r2 + T(2) * y * y) + T(2) * d[3] * x * y;
  px = {f[0] * xd + c[0], f[0] * form.aspect * yd + c[1]};
  return true;
}

struct Reprojection {
  LensForm form;
  Eigen::Vector2d pixel;
  double inverse_sigma;

  template <class T>
  bool operator()(const T* position, const T* rotation, const T* point, const T* lens, T* residual) const {
    const Eigen::Map<const Eigen::Quaternion<T>> q(rotation);
    const Eigen::Map<const Eigen::Matrix<T, 3, 1>> c(position), x(point);
    const Eigen::Matrix<T, 3, 1> in_camera = q.conjugate() * (x - c);
    Eigen::Matrix<T, 2, 1> px;
    if (!project(form, lens, in_camera, px)) return false;
    residual[0] = (px.x() - pixel.x()) * inverse_sigma;
    residual[1] = (px.y() - pixel.y()) * inverse_sigma;
    return true;
  }
};

// antenna(t - delay) + offset = telemetry(t), the track before t being known from the frames before.
struct PositionPrior {
  Eigen::Vector3d said, displacement, velocity;
  double delay_at;
  Eigen::Matrix3d sqrt_information;

  template <class T>
  bool operator()(const T* centre, const T* rotation, const T* lever, const T* offset, const T* delay,
                  T* residual) const {
    const Eigen::Map<const Eigen::Quaternion<T>> q(rotation);
    const Eigen::Map<const Eigen::Matrix<T, 3, 1>> c(centre), l(lever), o(offset);
    const Eigen::Matrix<T, 3, 1> then =
        c + displacement.cast<T>() - velocity.cast<T>() * (delay[0] - T(delay_at));
    Eigen::Map<Eigen::Matrix<T, 3, 1>> r(residual);
    r = sqrt_information.cast<T>() * (then + q * l + o - said.cast<T>());
    return true;
  }
};

// camera(t - delay) = telemetry(t) * exp(boresight), compared on the ENU side.
struct AttitudePrior {
  Eigen::Quaterniond said, turn;
  Eigen::Matrix3d sqrt_information;

  template <class T>
  bool operator()(const T* rotation, const T* boresight, T* residual) const {
    const Eigen::Map<const Eigen::Quaternion<T>> q(rotation);
    T sight_q[4];  // Ceres order w, x, y, z
    ceres::AngleAxisToQuaternion(boresight, sight_q);
    const Eigen::Quaternion<T> apart =
        turn.cast<T>() * q *
        (said.cast<T>() * Eigen::Quaternion<T>(sight_q[0], sight_q[1], sight_q[2], sight_q[3])).conjugate();
    const T wxyz[4] = {apart.w(), apart.x(), apart.y(), apart.z()};
    Eigen::Matrix<T, 3, 1> v;
    ceres::QuaternionToAngleAxis(wxyz, v.data());
    Eigen::Map<Eigen::Matrix<T, 3, 1>> r(residual);
    r = sqrt_information.cast<T>() * v;
    return true;
  }
};

// A frame held to where it was, by its own uncertainty.
struct HeldPosition {
  Eigen::Vector3d place;
  Eigen::Matrix3d sqrt_information;

  template <class T>
  bool operator()(const T* centre, T* residual) const {
    Eigen::Map<Eigen::Matrix<T, 3, 1>> r(residual);
    r = sqrt_information.cast<T>() * (Eigen::Map<const Eigen::Matrix<T, 3, 1>>(centre) - place.cast<T>());
    return true;
  }
};

struct HeldAttitude {
  Eigen::Quaterniond enu_from_camera;
  Eigen::Matrix3d sqrt_information;

  template <class T>
  bool operator()(const T* rotation, T* residual) const {
    const Eigen::Quaternion<T> apart =
        Eigen::Map<const Eigen::Quaternion<T>>(rotation) * enu_from_camera.conjugate().cast<T>();
    const T wxyz[4] = {apart.w(), apart.x(), apart.y(), apart.z()};
    Eigen::Matrix<T, 3, 1> v;
    ceres::QuaternionToAngleAxis(wxyz, v.data());
    Eigen::Map<Eigen::Matrix<T, 3, 1>> r(residual);
    r = sqrt_information.cast<T>() * v;
    return true;
  }
};

// Independent priors on the entries of one block; a zero sigma leaves its entry out (it is held constant).
template <int N>
struct BlockPrior {
  Eigen::Matrix<double, N, 1> centre, inverse_sigma;

  template <class T>
  bool operator()(const T* value, T* residual) const {
    for (int i = 0; i < N; ++i) residual[i] = (value[i] - centre[i]) * inverse_sigma[i];
    return true;
  }
};

}  // namespace overfly::tiling::adjust::detail
