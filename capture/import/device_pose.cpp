#include "capture/import/device_pose.h"

#include "capture/geo/footprint.h"
#include "capture/geo/geodetic.h"

namespace overfly::capture {

std::optional<Pose> devicePose(const RawTelemetry& raw, std::int64_t time_ns,
                               const DeviceAccuracy& accuracy) {
  if (!raw.lat || !raw.lon || !raw.altitude_m || !raw.gimbal_yaw || !raw.gimbal_pitch || !raw.gimbal_roll) {
    return std::nullopt;
  }
  const geo::Geodetic place{*raw.lat, *raw.lon, *raw.altitude_m};
  const Eigen::Quaterniond ecef_from_enu(geo::LocalFrame(place).enuFromEcefRotation().transpose());
  Pose pose;
  pose.time_ns = time_ns;
  pose.position_in_ecef = geo::ecefFromGeodetic(place);
  pose.ecef_from_camera =
      (ecef_from_enu * geo::enuFromCamera(*raw.gimbal_yaw, *raw.gimbal_pitch, *raw.gimbal_roll)).normalized();
  const auto variance = [](double sigma) { return sigma * sigma; };
  pose.covariance.diagonal() << variance(raw.std_east_m.value_or(accuracy.horizontal_m)),
      variance(raw.std_north_m.value_or(accuracy.horizontal_m)),
      variance(raw.std_up_m.value_or(accuracy.vertical_m)), variance(accuracy.tilt), variance(accuracy.tilt),
      variance(accuracy.heading);
  return pose;
}

}  // namespace overfly::capture
