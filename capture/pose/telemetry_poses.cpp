#include "capture/pose/telemetry_poses.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "capture/geo/geodetic.h"

namespace overfly::capture {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
constexpr std::int64_t kKeep_ns = 10 * kSecond;
constexpr std::int64_t kPreferred_ns =
    2 * kSecond;                                  // the better message is silent for so long: take the other
constexpr std::int64_t kDecide_ns = 3 * kSecond;  // wait so long for the receiver's own undulation
constexpr std::int64_t kLatest_ns = 5 * kSecond;  // a message is not older than this when it comes
constexpr std::int64_t kFuture_ns = 50'000'000;
constexpr std::uint64_t kUnixFrom_us = std::uint64_t{1} << 50;
constexpr std::int64_t k2015_ns = 1'420'070'400 * kSecond;
constexpr std::size_t kMaxClocks = 8;
constexpr std::size_t kMaxDue = 4096;

// GIMBAL_DEVICE_FLAGS
constexpr unsigned kYawLock = 16, kYawInVehicleFrame = 32, kYawInEarthFrame = 64;

constexpr double kDefaultPosition_m = 2.0;
constexpr double kDefaultTilt = 0.035, kDefaultHeading = 0.087;

double seconds(std::int64_t from_ns, std::int64_t to_ns) {
  return static_cast<double>(to_ns - from_ns) * 1e-9;
}
double square(double x) { return x * x; }

double headingOf(const Eigen::Quaterniond& ned_from_body) {
  const Eigen::Vector3d forward = ned_from_body * Eigen::Vector3d::UnitX();
  return std::atan2(forward.y(), forward.x());
}

const Eigen::Quaterniond& enuFromNed() {
  static const Eigen::Quaterniond q(Eigen::Matrix3d{{0, 1, 0}, {1, 0, 0}, {0, 0, -1}});
  return q;
}

// The last entry at or before and the first after a time; nullopt outside, or across a gap.
template <class T>
std::optional<std::pair<typename std::map<std::int64_t, T>::const_iterator,
                        typename std::map<std::int64_t, T>::const_iterator>>
around(const std::map<std::int64_t, T>& history, std::int64_t time_ns, std::int64_t max_gap_ns) {
  const auto after = history.lower_bound(time_ns);
  if (after == history.end()) return std::nullopt;
  if (after->first == time_ns) return std::pair{after, after};
  if (after == history.begin()) return std::nullopt;
  const auto before = std::prev(after);
  if (after->first - before->first > max_gap_ns) return std::nullopt;
  return std::pair{before, after};
}

template <class T>
void prune(std::map<std::int64_t, T>& history) {
  if (history.empty()) return;
  const std::int64_t newest = history.rbegin()->first;
  while (newest - history.begin()->first > kKeep_ns) history.erase(history.begin());
}

}  // namespace

TelemetryPoses::TelemetryPoses(TelemetryOptions options, PoseTrack& track)
    : options_(std::move(options)), track_(track) {}

void TelemetryPoses::take(const mavlink::Packet& packet, std::int64_t arrival_ns) {
  const std::uint32_t id = packet.info->id;
  if (packet.from.system != options_.autopilot.system) return;
  // A gimbal is a component of its own, or the autopilot speaks for it.
  if (id == mavlink::GimbalDeviceAttitudeStatus::kId) {
    takeGimbal(mavlink::decode<mavlink::GimbalDeviceAttitudeStatus>(packet), packet, arrival_ns);
    return;
  }
  if (packet.from != options_.autopilot) return;
  switch (id) {
    case mavlink::GlobalPositionInt::kId:
      return takePosition(mavlink::decode<mavlink::GlobalPositionInt>(packet), arrival_ns);
    case mavlink::GpsRawInt::kId:
      return takeReceiver(mavlink::decode<mavlink::GpsRawInt>(packet), arrival_ns);
    case mavlink::AttitudeQuaternion::kId: {
      const auto m = mavlink::decode<mavlink::AttitudeQuaternion>(packet);
      last_quaternion_ns_ = arrival_ns;
      const double rate = Eigen::Vector3d(m.rollspeed, m.pitchspeed, m.yawspeed).norm();
      return takeAttitude(m.time_boot_ms, Eigen::Quaterniond(m.q1, m.q2, m.q3, m.q4), rate, arrival_ns);
    }
    case mavlink::Attitude::kId: {
      if (last_quaternion_ns_ != 0 && arrival_ns - last_quaternion_ns_ < kPreferred_ns) return;
      const auto m = mavlink::decode<mavlink::Attitude>(packet);
      const Eigen::Quaterniond q = Eigen::AngleAxisd(m.yaw, Eigen::Vector3d::UnitZ()) *
                                   Eigen::AngleAxisd(m.pitch, Eigen::Vector3d::UnitY()) *
                                   Eigen::AngleAxisd(m.roll, Eigen::Vector3d::UnitX());
      const double rate = Eigen::Vector3d(m.rollspeed, m.pitchspeed, m.yawspeed).norm();
      return takeAttitude(m.time_boot_ms, q, rate, arrival_ns);
    }
    case mavlink::SystemTime::kId:
      return takeSystemTime(mavlink::decode<mavlink::SystemTime>(packet), arrival_ns);
    default:
      return;
  }
}

void TelemetryPoses::addClockPair(std::int64_t device_ns, std::int64_t boottime_ns, std::int64_t sigma_ns) {
  clocks_[options_.autopilot].addPair(device_ns, boottime_ns, sigma_ns);
}

std::optional<ClockRecovery::Time> TelemetryPoses::timeOf(mavlink::Address from, std::uint32_t time_boot_ms,
                                                          std::int64_t arrival_ns) {
  if (!clocks_.contains(from) && clocks_.size() >= kMaxClocks) return std::nullopt;
  ClockRecovery& clock = clocks_[from];
  const auto expected = clock.deviceFrom(arrival_ns);
  // The counter of 32 bits begins again after 49.7 days.
  const std::int64_t ms = expected ? unwrap32(time_boot_ms, *expected / 1'000'000) : time_boot_ms;
  clock.addArrival(ms * 1'000'000, arrival_ns);
  const auto time = clock.boottimeFrom(ms * 1'000'000);
  if (!time || !plausible(*time, arrival_ns)) return std::nullopt;
  return time;
}

bool TelemetryPoses::plausible(const ClockRecovery::Time& time, std::int64_t arrival_ns) {
  if (time.ns > arrival_ns - kLatest_ns &&
      time.ns < arrival_ns + kFuture_ns + 6 * std::min(time.sigma_ns, kSecond))
    return true;
  drop("wrong time");
  return false;
}

void TelemetryPoses::takeSystemTime(const mavlink::SystemTime& m, std::int64_t arrival_ns) {
  const auto time = timeOf(options_.autopilot, m.time_boot_ms, arrival_ns);
  constexpr auto kMost = static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max() / 4000);
  if (!time || m.time_unix_usec > kMost) return;
  const auto unix_ns = static_cast<std::int64_t>(m.time_unix_usec) * 1000;
  if (unix_ns < k2015_ns) return drop("no UTC yet");
  utc_.addPair(unix_ns, time->ns, std::max<std::int64_t>(time->sigma_ns, 1'000'000));
}

void TelemetryPoses::takeReceiver(const mavlink::GpsRawInt& m, std::int64_t arrival_ns) {
  receiver_ = m;
  status_.fix_type = m.fix_type;
  if (last_global_ns_ != 0 && arrival_ns - last_global_ns_ < kPreferred_ns) return;
  if (m.fix_type < 3) return drop("no position fix");
  const auto time = boottimeFromUsec(m.time_usec);
  if (!time) return drop("no clock yet");
  if (!plausible(*time, arrival_ns)) return;
  Position position;
  position.time_sigma_ns = time->sigma_ns;
  position.lat = geo::radians(m.lat * 1e-7);
  position.lon = geo::radians(m.lon * 1e-7);
  if (options_.height == HeightFrom::Home) return drop("no height above home");
  const auto up = height(position.lat, position.lon, m.alt * 1e-3, 0, arrival_ns);
  if (!up) return;
  status_.position = "GPS_RAW_INT";
  addPosition(time->ns, position, *up);
}

void TelemetryPoses::takePosition(const mavlink::GlobalPositionInt& m, std::int64_t arrival_ns) {
  const auto time = timeOf(options_.autopilot, m.time_boot_ms, arrival_ns);
  if (!time) return;
  last_global_ns_ = arrival_ns;
  if (m.lat == 0 && m.lon == 0) return drop("no position fix");
  if (receiver_ && receiver_->fix_type < 3) return drop("no position fix");
  Position position;
  position.time_sigma_ns = time->sigma_ns;
  position.lat = geo::radians(m.lat * 1e-7);
  position.lon = geo::radians(m.lon * 1e-7);
  const auto up = height(position.lat, position.lon, m.alt * 1e-3, m.relative_alt * 1e-3, arrival_ns);
  if (!up) return;
  status_.position = "GLOBAL_POSITION_INT";
  if (!status_.home_height_m) status_.home_height_m = *up - m.relative_alt * 1e-3;
  const Eigen::Matrix3d enu_from_ecef =
      geo::LocalFrame({position.lat, position.lon, *up}).enuFromEcefRotation();
  position.velocity_in_ecef =
      enu_from_ecef.transpose() * Eigen::Vector3d(m.vy * 0.01, m.vx * 0.01, -m.vz * 0.01);
  addPosition(time->ns, position, *up);
}

std::optional<double> TelemetryPoses::height(double lat, double lon, double msl_m, double home_m,
                                             std::int64_t arrival_ns) {
  // Mixed references would tear the map: the choice is made once.
  const bool receiver_knows = receiver_ && receiver_->alt_ellipsoid != 0;
  if (heights_ == Heights::Undecided) {
    if (first_position_ns_ == 0) first_position_ns_ = arrival_ns;
    const bool wait = arrival_ns - first_position_ns_ < kDecide_ns;
    if (options_.height == HeightFrom::Home) {
      heights_ = Heights::Home;
      status_.datum = VerticalDatum::Home;
      status_.height_reason = "above home, as the autopilot says; not shifted";
    } else if (options_.height == HeightFrom::Msl) {
      heights_ = Heights::Msl;
      status_.datum = VerticalDatum::Geoid;
      status_.height_reason = "above mean sea level, as the autopilot says; not shifted";
    } else if (options_.geoid && std::isfinite(options_.geoid->undulation(lat, lon))) {
      heights_ = Heights::Model;
      status_.datum = VerticalDatum::Ellipsoid;
      status_.height_reason =
          fmt::format("above the ellipsoid: the autopilot's mean sea level plus {} ({:+.2f} m here)",
                      options_.geoid->name(), options_.geoid->undulation(lat, lon));
    } else if (receiver_knows) {
      heights_ = Heights::Receiver;
      status_.datum = VerticalDatum::Ellipsoid;
      status_.height_reason = fmt::format(
          "above the ellipsoid: the autopilot's mean sea level plus the receiver's own undulation ({:+.2f} m "
          "here); no geoid model is installed",
          (receiver_->alt_ellipsoid - receiver_->alt) * 1e-3);
    } else if (options_.height == HeightFrom::Ellipsoid || wait) {
      drop("no height above the ellipsoid");
      return std::nullopt;
    } else {
      heights_ = Heights::Msl;
      status_.datum = VerticalDatum::Geoid;
      status_.height_reason =
          "above mean sea level, as the autopilot says; not shifted, for no geoid model is installed (Debian "
          "package proj-data) and the receiver tells no ellipsoidal height";
    }
  }
  switch (heights_) {
    case Heights::Home:
      return home_m;
    case Heights::Model:
      return options_.geoid->ellipsoidalFromGeoid(lat, lon, msl_m);
    case Heights::Receiver:
      return msl_m + (receiver_->alt_ellipsoid - receiver_->alt) * 1e-3;
    default:
      return msl_m;
  }
}

void TelemetryPoses::addPosition(std::int64_t time_ns, Position position, double up_m) {
  if (std::abs(position.lat) > M_PI / 2 || !std::isfinite(up_m)) return drop("not finite");
  position.in_ecef = geo::ecefFromGeodetic({position.lat, position.lon, up_m});
  const bool known = receiver_ && receiver_->h_acc > 0 && receiver_->v_acc > 0;
  position.horizontal_m = position.vertical_m = kDefaultPosition_m;
  if (known) {
    position.horizontal_m = receiver_->h_acc * 1e-3;
    position.vertical_m = receiver_->v_acc * 1e-3;
  }
  if (options_.position_sigma_m > 0) position.horizontal_m = position.vertical_m = options_.position_sigma_m;
  positions_.insert_or_assign(time_ns, position);
  prune(positions_);
  due_.insert(time_ns);
  emit();
}

void TelemetryPoses::takeAttitude(std::uint32_t time_boot_ms, const Eigen::Quaterniond& q, double rate,
                                  std::int64_t arrival_ns) {
  const auto time = timeOf(options_.autopilot, time_boot_ms, arrival_ns);
  if (!time) return;
  if (!(std::abs(q.norm() - 1) < 0.01) || !std::isfinite(rate)) return drop("not finite");
  body_.insert_or_assign(time->ns, Orientation{q.normalized(), rate, time->sigma_ns, false, std::nullopt});
  prune(body_);
  if (!usesGimbal()) due_.insert(time->ns);
  emit();
}

void TelemetryPoses::takeGimbal(const mavlink::GimbalDeviceAttitudeStatus& m, const mavlink::Packet& packet,
                                std::int64_t arrival_ns) {
  if (options_.attitude == AttitudeFrom::Body) return;
  if (!gimbal_from_) gimbal_from_ = packet.from;
  if (*gimbal_from_ != packet.from) return drop("a second gimbal");
  const auto time = timeOf(packet.from, m.time_boot_ms, arrival_ns);
  if (!time) return;
  const Eigen::Quaterniond q(m.q[0], m.q[1], m.q[2], m.q[3]);
  const double rate =
      Eigen::Vector3d(m.angular_velocity_x, m.angular_velocity_y, m.angular_velocity_z).norm();
  if (!(std::abs(q.norm() - 1) < 0.01)) return drop("not finite");
  Orientation orientation{q.normalized(), std::isfinite(rate) ? rate : 0, time->sigma_ns, false,
                          std::nullopt};
  if ((m.flags & (kYawInVehicleFrame | kYawInEarthFrame)) == (kYawInVehicleFrame | kYawInEarthFrame))
    return drop("gimbal flags that contradict each other");
  orientation.in_vehicle =
      (m.flags & kYawInVehicleFrame) != 0 || (m.flags & (kYawInEarthFrame | kYawLock)) == 0;
  // The extension: zero where it is not sent, as trailing zeros are not.
  if (std::isfinite(m.delta_yaw) && m.delta_yaw != 0.0F) orientation.heading = m.delta_yaw;
  gimbal_.insert_or_assign(time->ns, orientation);
  prune(gimbal_);
  due_.insert(time->ns);
  emit();
}

bool TelemetryPoses::usesGimbal() const {
  return options_.attitude == AttitudeFrom::Gimbal ||
         (options_.attitude == AttitudeFrom::Auto && !gimbal_.empty());
}

void TelemetryPoses::emit() {
  const History<Orientation>& orientations = usesGimbal() ? gimbal_ : body_;
  if (positions_.empty() || orientations.empty()) {
    while (due_.size() > kMaxDue) due_.erase(due_.begin());
    return;
  }
  std::int64_t until = std::min(positions_.rbegin()->first, orientations.rbegin()->first);
  // The vehicle's heading at the gimbal's times is waited for, unless there is none at all.
  const bool in_vehicle = usesGimbal() && gimbal_.rbegin()->second.in_vehicle;
  if (in_vehicle && !body_.empty() && until - body_.rbegin()->first < options_.max_gap_ns)
    until = std::min(until, body_.rbegin()->first);
  while (!due_.empty() && *due_.begin() <= until) {
    const std::int64_t time_ns = *due_.begin();
    due_.erase(due_.begin());
    const auto pose = poseAt(time_ns);
    if (!pose) {
      drop("a gap in the telemetry");
      continue;
    }
    if (!track_.add(*pose)) {
      drop("not finite");
      continue;
    }
    ++status_.poses;
    status_.attitude = usesGimbal() ? "gimbal" : "body";
  }
  while (due_.size() > kMaxDue) due_.erase(due_.begin());
}

std::optional<TelemetryPoses::Orientation> TelemetryPoses::orientationAt(const History<Orientation>& history,
                                                                         std::int64_t time_ns) const {
  const auto found = around(history, time_ns, options_.max_gap_ns);
  if (!found) return std::nullopt;
  const auto& [before, after] = *found;
  if (before == after) return before->second;
  if (before->second.in_vehicle != after->second.in_vehicle) return std::nullopt;
  const double s = seconds(before->first, time_ns) / seconds(before->first, after->first);
  Orientation out = s < 0.5 ? before->second : after->second;
  out.q = before->second.q.slerp(s, after->second.q).normalized();
  out.rate = std::max(before->second.rate, after->second.rate);
  return out;
}

std::optional<Pose> TelemetryPoses::poseAt(std::int64_t time_ns) const {
  const auto found = around(positions_, time_ns, options_.max_gap_ns);
  if (!found) return std::nullopt;
  const auto& [before, after] = *found;
  const Position& a = before->second;
  const Position& b = after->second;
  Pose pose;
  pose.time_ns = time_ns;
  pose.position_in_ecef = a.in_ecef;
  Eigen::Vector3d velocity = a.velocity_in_ecef.value_or(Eigen::Vector3d::Zero());
  if (before != after) {
    // Cubic Hermite; differences are taken from `a`, so that no large number is rounded.
    const double length = seconds(before->first, after->first), s = seconds(before->first, time_ns) / length;
    const Eigen::Vector3d chord = b.in_ecef - a.in_ecef;
    const Eigen::Vector3d va = a.velocity_in_ecef.value_or(chord / length);
    const Eigen::Vector3d vb = b.velocity_in_ecef.value_or(chord / length);
    const double s2 = s * s, s3 = s2 * s;
    pose.position_in_ecef +=
        (3 * s2 - 2 * s3) * chord + (s3 - 2 * s2 + s) * length * va + (s3 - s2) * length * vb;
    velocity = chord / length;
  }

  const bool gimballed = usesGimbal();
  auto mount = orientationAt(gimballed ? gimbal_ : body_, time_ns);
  if (!mount) return std::nullopt;
  const auto body = gimballed ? orientationAt(body_, time_ns) : mount;
  if (mount->in_vehicle) {
    const std::optional<double> heading = body ? std::optional(headingOf(body->q)) : mount->heading;
    if (!heading) return std::nullopt;
    mount->q = Eigen::AngleAxisd(*heading, Eigen::Vector3d::UnitZ()) * mount->q;
  }
  const Eigen::Matrix3d enu_from_ecef = geo::LocalFrame({a.lat, a.lon, 0}).enuFromEcefRotation();
  const Eigen::Quaterniond ecef_from_ned = Eigen::Quaterniond(enu_from_ecef.transpose()) * enuFromNed();
  pose.ecef_from_camera = (ecef_from_ned * mount->q).normalized();

  const double tilt = options_.attitude_sigma > 0 ? options_.attitude_sigma : kDefaultTilt;
  double heading_sigma = options_.attitude_sigma > 0 ? options_.attitude_sigma : kDefaultHeading;
  if (options_.attitude_sigma <= 0 && receiver_ && receiver_->hdg_acc > 0)
    heading_sigma = std::min(heading_sigma, geo::radians(receiver_->hdg_acc * 1e-5));
  pose.covariance.diagonal() << square(a.horizontal_m), square(a.horizontal_m), square(a.vertical_m),
      square(tilt), square(tilt), square(heading_sigma);
  const Eigen::Vector3d smear = enu_from_ecef * velocity * (static_cast<double>(a.time_sigma_ns) * 1e-9);
  pose.covariance.topLeftCorner<3, 3>() += smear * smear.transpose();
  pose.covariance.diagonal().tail<3>().array() +=
      square(mount->rate * static_cast<double>(mount->time_sigma_ns) * 1e-9);

  if (!options_.lever_arm_in_body.isZero()) {
    if (!body) return std::nullopt;
    pose.position_in_ecef += ecef_from_ned * (body->q * options_.lever_arm_in_body);
    pose.covariance.diagonal().head<3>().array() +=
        options_.lever_arm_in_body.squaredNorm() * square(std::max(tilt, heading_sigma));
  }
  return pose;
}

std::optional<ClockRecovery::Time> TelemetryPoses::boottimeFromUsec(std::uint64_t usec) const {
  if (usec > static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max() / 4000)) return std::nullopt;
  const std::int64_t ns = static_cast<std::int64_t>(usec) * 1000;
  if (usec >= kUnixFrom_us) return utc_.boottimeFrom(ns);
  const auto clock = clocks_.find(options_.autopilot);
  return clock == clocks_.end() ? std::nullopt : clock->second.boottimeFrom(ns);
}

std::optional<std::int64_t> TelemetryPoses::autopilotTime(std::int64_t boottime_ns) const {
  const auto clock = clocks_.find(options_.autopilot);
  return clock == clocks_.end() ? std::nullopt : clock->second.deviceFrom(boottime_ns);
}

std::optional<ClockRecovery::Time> TelemetryPoses::utcOffset(std::int64_t boottime_ns) const {
  const auto utc = utc_.deviceFrom(boottime_ns);
  if (!utc) return std::nullopt;
  const auto back = utc_.boottimeFrom(*utc);
  return ClockRecovery::Time{*utc - boottime_ns, back ? back->sigma_ns : 0};
}

TelemetryStatus TelemetryPoses::status(std::int64_t now_ns) const {
  TelemetryStatus status = status_;
  if (const auto found = clocks_.find(options_.autopilot); found != clocks_.end()) {
    const ClockRecovery& clock = found->second;
    status.clock = clock.counts();
    status.clock_paired = clock.paired();
    status.clock_drift_ppm = clock.drift() * 1e6;
    if (const auto device = clock.deviceFrom(now_ns))
      if (const auto time = clock.boottimeFrom(*device))
        status.clock_sigma_s = static_cast<double>(time->sigma_ns) * 1e-9;
  }
  return status;
}

}  // namespace overfly::capture
