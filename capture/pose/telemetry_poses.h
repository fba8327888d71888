#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "capture/frame.h"
#include "capture/geo/vertical_datum.h"
#include "capture/pose/clock_recovery.h"
#include "capture/pose/mavlink/codec.h"
#include "capture/pose_track.h"

namespace overfly::capture {

// Whose attitude the camera shares: the vehicle's, or the gimbal's. Auto: the gimbal's once one has spoken.
enum class AttitudeFrom { Auto, Body, Gimbal };

// Which height becomes the pose's. An autopilot speaks of heights above mean sea level (by its own geoid) and
// above home.
//   Auto: above the ellipsoid: mean sea level plus the geoid model's undulation; without a model, plus the
//     undulation that the receiver itself works with; without either, above mean sea level as it is.
//   Ellipsoid: the same, but never above mean sea level: no pose until an undulation is known.
//   Msl: above mean sea level as it is. Home: above home as it is.
enum class HeightFrom { Auto, Ellipsoid, Msl, Home };

struct TelemetryOptions {
  mavlink::Address autopilot{1, 1};
  AttitudeFrom attitude = AttitudeFrom::Auto;
  HeightFrom height = HeightFrom::Auto;
  std::optional<geo::Geoid> geoid;
  Eigen::Vector3d lever_arm_in_body =
      Eigen::Vector3d::Zero();  // camera minus antenna; forward, right, down, m
  // 1 sigma; 0: what the receiver says, else 2 m, and 2 and 5 degrees (tilt, heading).
  double position_sigma_m = 0;
  double attitude_sigma = 0;              // rad, for all three axes
  std::int64_t max_gap_ns = 500'000'000;  // between messages; a longer gap is not bridged
};

// What became of the telemetry. Counts since the start, by reason.
struct TelemetryStatus {
  std::map<std::string, std::uint64_t> dropped;  // "no position fix", "wrong time", "not finite", ...
  std::uint64_t poses = 0;
  VerticalDatum datum = VerticalDatum::Unknown;  // of the poses' heights; Unknown before the first
  std::string height_reason;                     // how the heights came to be, for a person
  std::string attitude;                          // "gimbal", "body", or empty before the first
  std::string position;                          // "GLOBAL_POSITION_INT", "GPS_RAW_INT", or empty
  std::optional<double> home_height_m;           // where the vehicle took off, in `datum`
  int fix_type = -1;                             // GPS_RAW_INT's; -1 before the first
  double clock_sigma_s = 0;                      // of the autopilot's clock against ours, now
  double clock_drift_ppm = 0;
  bool clock_paired = false;  // by TIMESYNC; else from arrivals alone
  ClockCounts clock;
};

// From MAVLink telemetry to poses of the camera's mount (axes forward, right, down; CameraMount's boresight
// turns them into the camera's), with the lever arm applied. Each component's boot clock is recovered apart.
// A pose is made at the time of each position and of each attitude, once messages on both sides of it have
// come: position by a cubic through both positions and velocities, attitude by SLERP. Its covariance holds
// the receiver's accuracy, the attitude's, and what the clock's uncertainty is at the vehicle's speed.
// GIMBAL_DEVICE_ATTITUDE_STATUS: yaw against north or against the vehicle's heading, as its flags say
// (common.xml); roll and pitch always against the horizon. Thread-bound; the track may be read by others.
class TelemetryPoses {
 public:
  TelemetryPoses(TelemetryOptions options, PoseTrack& track);

  // Any packet; those of other senders and of no use here are let pass.
  void take(const mavlink::Packet& packet, std::int64_t arrival_ns);
  // A TIMESYNC answer: the autopilot's clock and ours at one instant.
  void addClockPair(std::int64_t device_ns, std::int64_t boottime_ns, std::int64_t sigma_ns);

  // A stamp of the autopilot in us, boot or Unix time by its size (2^50 us is 35 years).
  [[nodiscard]] std::optional<ClockRecovery::Time> boottimeFromUsec(std::uint64_t usec) const;
  // The autopilot's boot time at ours.
  [[nodiscard]] std::optional<std::int64_t> autopilotTime(std::int64_t boottime_ns) const;
  // Add to our time for UTC, by the autopilot; nullopt until it knows (before 2015 it does not).
  [[nodiscard]] std::optional<ClockRecovery::Time> utcOffset(std::int64_t boottime_ns) const;

  [[nodiscard]] TelemetryStatus status(std::int64_t now_ns) const;

 private:
  struct Position {
    Eigen::Vector3d in_ecef = Eigen::Vector3d::Zero();
    std::optional<Eigen::Vector3d> velocity_in_ecef;
    double lat = 0, lon = 0;
    std::int64_t time_sigma_ns = 0;
    double horizontal_m = 0, vertical_m = 0;
  };
  struct Orientation {
    Eigen::Quaterniond q;  // into NED, or (gimbal, in_vehicle) into the vehicle's levelled frame
    double rate = 0;       // rad/s
    std::int64_t time_sigma_ns = 0;
    bool in_vehicle = false;
    std::optional<double> heading;  // of the vehicle as the gimbal has it
  };
  template <class T>
  using History = std::map<std::int64_t, T>;

  void takePosition(const mavlink::GlobalPositionInt& m, std::int64_t arrival_ns);
  void takeReceiver(const mavlink::GpsRawInt& m, std::int64_t arrival_ns);
  void takeAttitude(std::uint32_t time_boot_ms, const Eigen::Quaterniond& q, double rate,
                    std::int64_t arrival_ns);
  void takeGimbal(const mavlink::GimbalDeviceAttitudeStatus& m, const mavlink::Packet& packet,
                  std::int64_t arrival_ns);
  void takeSystemTime(const mavlink::SystemTime& m, std::int64_t arrival_ns);

  [[nodiscard]] std::optional<ClockRecovery::Time> timeOf(mavlink::Address from, std::uint32_t time_boot_ms,
                                                          std::int64_t arrival_ns);
  [[nodiscard]] bool plausible(const ClockRecovery::Time& time, std::int64_t arrival_ns);
  // Ellipsoidal or other, as the options say; nullopt: not known yet.
  [[nodiscard]] std::optional<double> height(double lat, double lon, double msl_m, double home_m,
                                             std::int64_t arrival_ns);
  void addPosition(std::int64_t time_ns, Position position, double up_m);
  void emit();
  [[nodiscard]] std::optional<Pose> poseAt(std::int64_t time_ns) const;
  [[nodiscard]] std::optional<Orientation> orientationAt(const History<Orientation>& history,
                                                         std::int64_t time_ns) const;
  [[nodiscard]] bool usesGimbal() const;
  void drop(const char* reason) { ++status_.dropped[reason]; }

  const TelemetryOptions options_;
  PoseTrack& track_;
  std::map<mavlink::Address, ClockRecovery> clocks_;
  ClockRecovery utc_;
  History<Position> positions_;
  History<Orientation> body_, gimbal_;
  std::set<std::int64_t> due_;  // times of poses that are not made yet
  std::optional<mavlink::Address> gimbal_from_;
  std::int64_t last_quaternion_ns_ = 0, last_global_ns_ = 0, first_position_ns_ = 0;  // arrivals
  std::optional<mavlink::GpsRawInt> receiver_;
  enum class Heights { Undecided, Model, Receiver, Msl, Home };
  Heights heights_ = Heights::Undecided;
  TelemetryStatus status_;
};

}  // namespace overfly::capture
