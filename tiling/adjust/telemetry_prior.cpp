#include "tiling/adjust/telemetry_prior.h"

#include <algorithm>
#include <cmath>

#include "capture/geo/footprint.h"
#include "capture/geo/geodetic.h"

namespace overfly::tiling::adjust {
namespace {

using geo::radians;

double square(double x) { return x * x; }

// Heading of the way from the nearest earlier to the nearest later recorded position; nullopt when it did
// not move.
std::optional<double> course(std::span<const capture::FlightFrame> frames, std::size_t i) {
  const auto place = [&](std::size_t k) -> std::optional<Eigen::Vector2d> {
    const auto& raw = frames[k].raw;
    if (!raw || !raw->lat || !raw->lon) return std::nullopt;
    return Eigen::Vector2d(*raw->lat, *raw->lon);
  };
  const auto from = place(i > 0 ? i - 1 : i), to = place(i + 1 < frames.size() ? i + 1 : i);
  if (!from || !to) return std::nullopt;
  const double north = (*to - *from).x(), east = (*to - *from).y() * std::cos(to->x());
  if (std::hypot(north, east) * 6.4e6 < 1) return std::nullopt;
  return std::atan2(east, north);
}

}  // namespace

void fillCovariance(capture::Pose& pose) {
  constexpr double kPosition = 3.0, kTilt = 0.035, kHeading = 0.087;
  for (int i = 0; i < 6; ++i)
    if (!(pose.covariance(i, i) > 0))
      pose.covariance(i, i) = i < 3 ? kPosition * kPosition : i < 5 ? kTilt * kTilt : kHeading * kHeading;
}

std::vector<TelemetryPrior> priorsFromTelemetry(std::span<const capture::FlightFrame> frames) {
  std::vector<TelemetryPrior> out(frames.size());
  std::optional<double> last_course;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const auto& raw = frames[i].raw;
    if (!raw || !raw->lat || !raw->lon) continue;
    capture::Pose pose;
    pose.time_ns = frames[i].frame.time_ns;
    const double height = raw->altitude_m.value_or(raw->relative_altitude_m.value_or(0));
    const geo::Geodetic place{*raw->lat, *raw->lon, height};
    pose.position_in_ecef = geo::ecefFromGeodetic(place);
    auto& variance = pose.covariance;
    variance(0, 0) = square(raw->std_east_m.value_or(5));
    variance(1, 1) = square(raw->std_north_m.value_or(5));
    const bool barometer = raw->relative_altitude_m.has_value();
    variance(2, 2) = square(raw->std_up_m.value_or(barometer ? 3 : 30));
    if (!barometer && !raw->std_up_m) out[i].assumed = "the altitude is not to be trusted";
    double yaw = 0, pitch = radians(-90), roll = 0, tilt_sigma = radians(10), yaw_sigma = radians(45);
    if (raw->gimbal_yaw && raw->gimbal_pitch) {
      yaw = *raw->gimbal_yaw;
      pitch = *raw->gimbal_pitch;
      roll = raw->gimbal_roll.value_or(0);
      tilt_sigma = radians(2);
      yaw_sigma = radians(5);
    } else if (raw->body_yaw && raw->body_pitch && raw->body_roll) {
      // A camera fixed to the body, looking down: the body's attitude, then a quarter turn down.
      yaw = *raw->body_yaw;
      tilt_sigma = radians(5);
      yaw_sigma = radians(10);
      const Eigen::Quaterniond enu_from_ned((Eigen::Matrix3d() << 0, 1, 0, 1, 0, 0, 0, 0, -1).finished());
      const Eigen::Quaterniond ned_from_body = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                                               Eigen::AngleAxisd(*raw->body_pitch, Eigen::Vector3d::UnitY()) *
                                               Eigen::AngleAxisd(*raw->body_roll, Eigen::Vector3d::UnitX());
      const Eigen::Quaterniond enu_from_level = geo::enuFromCamera(0, pitch, 0);
      const Eigen::Quaterniond body_from_camera = enu_from_ned.conjugate() * enu_from_level;
      pose.ecef_from_camera = enu_from_ned * ned_from_body * body_from_camera;
    } else {
      const auto heading = course(frames, i);
      if (heading) last_course = heading;
      yaw = last_course.value_or(0);
      if (!heading) yaw_sigma = radians(last_course ? 90 : 180);
      out[i].assumed = "looking straight down, its top along the course" +
                       (out[i].assumed.empty() ? std::string() : "; " + out[i].assumed);
    }
    const bool from_body =
        !(raw->gimbal_yaw && raw->gimbal_pitch) && raw->body_yaw && raw->body_pitch && raw->body_roll;
    const Eigen::Quaterniond enu_from_camera =
        from_body ? pose.ecef_from_camera : geo::enuFromCamera(yaw, pitch, roll);
    const geo::LocalFrame local(place);
    pose.ecef_from_camera =
        (Eigen::Quaterniond(local.enuFromEcefRotation().transpose()) * enu_from_camera).normalized();
    variance(3, 3) = variance(4, 4) = square(tilt_sigma);
    variance(5, 5) = square(yaw_sigma);
    out[i].pose = pose;
  }
  return out;
}

}  // namespace overfly::tiling::adjust
