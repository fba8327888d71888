#pragma once
#include <array>
#include <cstdint>
#include <string_view>
#include <tuple>

// The MAVLink messages that a camera payload needs, as plain values. Facts from the message definitions of
// the MAVLink project (message_definitions/v1.0/common.xml): names, types, units. Members and fields() stand
// in the order of the wire: base fields by falling size, then extensions as they were added. fields() visits
// (name on the wire, member); everything else (length, CRC_EXTRA, encoding) follows from it.
// Units are the wire's: degE7 = 1e-7 degrees, mm, cm/s, ms and us since the sender's boot unless said.
namespace overfly::mavlink {

template <std::size_t N>
using Text = std::array<char, N>;  // zero-terminated unless full

struct Heartbeat {
  static constexpr std::uint32_t kId = 0;
  static constexpr std::string_view kName = "HEARTBEAT";
  static constexpr int kBaseFields = 6;
  std::uint32_t custom_mode = 0;
  std::uint8_t type = 0;           // MAV_TYPE
  std::uint8_t autopilot = 0;      // MAV_AUTOPILOT
  std::uint8_t base_mode = 0;      // MAV_MODE_FLAG bits
  std::uint8_t system_status = 0;  // MAV_STATE
  std::uint8_t mavlink_version = 3;
  static constexpr void fields(auto& m, auto&& f) {
    f("custom_mode", m.custom_mode);
    f("type", m.type);
    f("autopilot", m.autopilot);
    f("base_mode", m.base_mode);
    f("system_status", m.system_status);
    f("mavlink_version", m.mavlink_version);
  }
};

struct SystemTime {
  static constexpr std::uint32_t kId = 2;
  static constexpr std::string_view kName = "SYSTEM_TIME";
  static constexpr int kBaseFields = 2;
  std::uint64_t time_unix_usec = 0;  // 0 or 1970 until the autopilot knows
  std::uint32_t time_boot_ms = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("time_unix_usec", m.time_unix_usec);
    f("time_boot_ms", m.time_boot_ms);
  }
};

struct GpsRawInt {
  static constexpr std::uint32_t kId = 24;
  static constexpr std::string_view kName = "GPS_RAW_INT";
  static constexpr int kBaseFields = 10;
  std::uint64_t time_usec = 0;  // Unix or boot time: by its size
  std::int32_t lat = 0, lon = 0;
  std::int32_t alt = 0;                 // mm above mean sea level
  std::uint16_t eph = 0, epv = 0;       // DOP times 100
  std::uint16_t vel = 0;                // cm/s over ground, 65535: unknown
  std::uint16_t cog = 0;                // 0.01 deg, 65535: unknown
  std::uint8_t fix_type = 0;            // 2: 2D, 3: 3D, 4: DGPS, 5: RTK float, 6: RTK fixed
  std::uint8_t satellites_visible = 0;  // 255: unknown
  std::int32_t alt_ellipsoid = 0;       // mm above WGS84; 0 where it is not sent
  std::uint32_t h_acc = 0, v_acc = 0;   // mm; 0 where it is not sent
  std::uint32_t vel_acc = 0;            // mm/s
  std::uint32_t hdg_acc = 0;            // degE5
  std::uint16_t yaw = 0;                // 0.01 deg of a two-antenna receiver; 0: none, 36000: north
  static constexpr void fields(auto& m, auto&& f) {
    f("time_usec", m.time_usec);
    f("lat", m.lat);
    f("lon", m.lon);
    f("alt", m.alt);
    f("eph", m.eph);
    f("epv", m.epv);
    f("vel", m.vel);
    f("cog", m.cog);
    f("fix_type", m.fix_type);
    f("satellites_visible", m.satellites_visible);
    f("alt_ellipsoid", m.alt_ellipsoid);
    f("h_acc", m.h_acc);
    f("v_acc", m.v_acc);
    f("vel_acc", m.vel_acc);
    f("hdg_acc", m.hdg_acc);
    f("yaw", m.yaw);
  }
};

struct Attitude {
  static constexpr std::uint32_t kId = 30;
  static constexpr std::string_view kName = "ATTITUDE";
  static constexpr int kBaseFields = 7;
  std::uint32_t time_boot_ms = 0;
  float roll = 0, pitch = 0, yaw = 0;  // rad, Z-Y'-X''
  float rollspeed = 0, pitchspeed = 0, yawspeed = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("time_boot_ms", m.time_boot_ms);
    f("roll", m.roll);
    f("pitch", m.pitch);
    f("yaw", m.yaw);
    f("rollspeed", m.rollspeed);
    f("pitchspeed", m.pitchspeed);
    f("yawspeed", m.yawspeed);
  }
};

struct AttitudeQuaternion {
  static constexpr std::uint32_t kId = 31;
  static constexpr std::string_view kName = "ATTITUDE_QUATERNION";
  static constexpr int kBaseFields = 8;
  std::uint32_t time_boot_ms = 0;
  float q1 = 1, q2 = 0, q3 = 0, q4 = 0;  // w, x, y, z; body (forward, right, down) into NED
  float rollspeed = 0, pitchspeed = 0, yawspeed = 0;
  std::array<float, 4> repr_offset_q{};  // for displays only
  static constexpr void fields(auto& m, auto&& f) {
    f("time_boot_ms", m.time_boot_ms);
    f("q1", m.q1);
    f("q2", m.q2);
    f("q3", m.q3);
    f("q4", m.q4);
    f("rollspeed", m.rollspeed);
    f("pitchspeed", m.pitchspeed);
    f("yawspeed", m.yawspeed);
    f("repr_offset_q", m.repr_offset_q);
  }
};

struct GlobalPositionInt {
  static constexpr std::uint32_t kId = 33;
  static constexpr std::string_view kName = "GLOBAL_POSITION_INT";
  static constexpr int kBaseFields = 9;
  std::uint32_t time_boot_ms = 0;
  std::int32_t lat = 0, lon = 0;
  std::int32_t alt = 0;                 // mm above mean sea level
  std::int32_t relative_alt = 0;        // mm above home
  std::int16_t vx = 0, vy = 0, vz = 0;  // cm/s north, east, down
  std::uint16_t hdg = 0;                // 0.01 deg, 65535: unknown
  static constexpr void fields(auto& m, auto&& f) {
    f("time_boot_ms", m.time_boot_ms);
    f("lat", m.lat);
    f("lon", m.lon);
    f("alt", m.alt);
    f("relative_alt", m.relative_alt);
    f("vx", m.vx);
    f("vy", m.vy);
    f("vz", m.vz);
    f("hdg", m.hdg);
  }
};

struct CommandLong {
  static constexpr std::uint32_t kId = 76;
  static constexpr std::string_view kName = "COMMAND_LONG";
  static constexpr int kBaseFields = 11;
  float param1 = 0, param2 = 0, param3 = 0, param4 = 0, param5 = 0, param6 = 0, param7 = 0;
  std::uint16_t command = 0;  // MAV_CMD
  std::uint8_t target_system = 0, target_component = 0;
  std::uint8_t confirmation = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("param1", m.param1);
    f("param2", m.param2);
    f("param3", m.param3);
    f("param4", m.param4);
    f("param5", m.param5);
    f("param6", m.param6);
    f("param7", m.param7);
    f("command", m.command);
    f("target_system", m.target_system);
    f("target_component", m.target_component);
    f("confirmation", m.confirmation);
  }
};

struct CommandAck {
  static constexpr std::uint32_t kId = 77;
  static constexpr std::string_view kName = "COMMAND_ACK";
  static constexpr int kBaseFields = 2;
  std::uint16_t command = 0;
  std::uint8_t result = 0;  // MAV_RESULT
  std::uint8_t progress = 0;
  std::int32_t result_param2 = 0;
  std::uint8_t target_system = 0, target_component = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("command", m.command);
    f("result", m.result);
    f("progress", m.progress);
    f("result_param2", m.result_param2);
    f("target_system", m.target_system);
    f("target_component", m.target_component);
  }
};

struct Timesync {
  static constexpr std::uint32_t kId = 111;
  static constexpr std::string_view kName = "TIMESYNC";
  static constexpr int kBaseFields = 2;
  std::int64_t tc1 = 0;  // ns of the answering side; 0 in a question
  std::int64_t ts1 = 0;  // ns of the asking side
  std::uint8_t target_system = 0, target_component = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("tc1", m.tc1);
    f("ts1", m.ts1);
    f("target_system", m.target_system);
    f("target_component", m.target_component);
  }
};

struct CameraTrigger {
  static constexpr std::uint32_t kId = 112;
  static constexpr std::string_view kName = "CAMERA_TRIGGER";
  static constexpr int kBaseFields = 2;
  std::uint64_t time_usec = 0;  // Unix or boot time: by its size
  std::uint32_t seq = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("time_usec", m.time_usec);
    f("seq", m.seq);
  }
};

struct CameraFeedback {
  static constexpr std::uint32_t kId = 180;
  static constexpr std::string_view kName = "CAMERA_FEEDBACK";
  static constexpr int kBaseFields = 13;
  std::uint64_t time_usec = 0;  // Unix or boot time: by its size
  std::int32_t lat = 0, lng = 0;
  float alt_msl = 0, alt_rel = 0;      // m
  float roll = 0, pitch = 0, yaw = 0;  // deg, of the camera
  float foc_len = 0;                   // mm
  std::uint16_t img_idx = 0;
  std::uint8_t target_system = 0;
  std::uint8_t cam_idx = 0;
  std::uint8_t flags = 0;
  std::uint16_t completed_captures = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("time_usec", m.time_usec);
    f("lat", m.lat);
    f("lng", m.lng);
    f("alt_msl", m.alt_msl);
    f("alt_rel", m.alt_rel);
    f("roll", m.roll);
    f("pitch", m.pitch);
    f("yaw", m.yaw);
    f("foc_len", m.foc_len);
    f("img_idx", m.img_idx);
    f("target_system", m.target_system);
    f("cam_idx", m.cam_idx);
    f("flags", m.flags);
    f("completed_captures", m.completed_captures);
  }
};

struct Statustext {
  static constexpr std::uint32_t kId = 253;
  static constexpr std::string_view kName = "STATUSTEXT";
  static constexpr int kBaseFields = 2;
  std::uint8_t severity = 6;  // MAV_SEVERITY: 4 warning, 6 info
  Text<50> text{};
  std::uint16_t id = 0;  // of a text longer than 50 bytes; 0: it is not
  std::uint8_t chunk_seq = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("severity", m.severity);
    f("text", m.text);
    f("id", m.id);
    f("chunk_seq", m.chunk_seq);
  }
};

struct CameraInformation {
  static constexpr std::uint32_t kId = 259;
  static constexpr std::string_view kName = "CAMERA_INFORMATION";
  static constexpr int kBaseFields = 13;
  std::uint32_t time_boot_ms = 0;
  std::uint32_t firmware_version = 0;  // dev, patch, minor, major from the highest byte down
  float focal_length = 0;              // mm; NaN: unknown
  float sensor_size_h = 0, sensor_size_v = 0;
  std::uint32_t flags = 0;  // CAMERA_CAP_FLAGS
  std::uint16_t resolution_h = 0, resolution_v = 0;
  std::uint16_t cam_definition_version = 0;
  std::array<std::uint8_t, 32> vendor_name{}, model_name{};
  std::uint8_t lens_id = 0;
  Text<140> cam_definition_uri{};
  std::uint8_t gimbal_device_id = 0;
  std::uint8_t camera_device_id = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("time_boot_ms", m.time_boot_ms);
    f("firmware_version", m.firmware_version);
    f("focal_length", m.focal_length);
    f("sensor_size_h", m.sensor_size_h);
    f("sensor_size_v", m.sensor_size_v);
    f("flags", m.flags);
    f("resolution_h", m.resolution_h);
    f("resolution_v", m.resolution_v);
    f("cam_definition_version", m.cam_definition_version);
    f("vendor_name", m.vendor_name);
    f("model_name", m.model_name);
    f("lens_id", m.lens_id);
    f("cam_definition_uri", m.cam_definition_uri);
    f("gimbal_device_id", m.gimbal_device_id);
    f("camera_device_id", m.camera_device_id);
  }
};

struct CameraSettings {
  static constexpr std::uint32_t kId = 260;
  static constexpr std::string_view kName = "CAMERA_SETTINGS";
  static constexpr int kBaseFields = 2;
  std::uint32_t time_boot_ms = 0;
  std::uint8_t mode_id = 0;  // CAMERA_MODE: 0 image, 1 video, 2 survey
  float zoom_level = 0, focus_level = 0;
  std::uint8_t camera_device_id = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("time_boot_ms", m.time_boot_ms);
    f("mode_id", m.mode_id);
    f("zoomLevel", m.zoom_level);
    f("focusLevel", m.focus_level);
    f("camera_device_id", m.camera_device_id);
  }
};

struct StorageInformation {
  static constexpr std::uint32_t kId = 261;
  static constexpr std::string_view kName = "STORAGE_INFORMATION";
  static constexpr int kBaseFields = 9;
  std::uint32_t time_boot_ms = 0;
  float total_capacity = 0, used_capacity = 0, available_capacity = 0;  // MiB
  float read_speed = 0, write_speed = 0;                                // MiB/s
  std::uint8_t storage_id = 0, storage_count = 0;
  std::uint8_t status = 0;  // STORAGE_STATUS: 2 ready
  std::uint8_t type = 0;    // STORAGE_TYPE
  Text<32> name{};
  std::uint8_t storage_usage = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("time_boot_ms", m.time_boot_ms);
    f("total_capacity", m.total_capacity);
    f("used_capacity", m.used_capacity);
    f("available_capacity", m.available_capacity);
    f("read_speed", m.read_speed);
    f("write_speed", m.write_speed);
    f("storage_id", m.storage_id);
    f("storage_count", m.storage_count);
    f("status", m.status);
    f("type", m.type);
    f("name", m.name);
    f("storage_usage", m.storage_usage);
  }
};

struct CameraCaptureStatus {
  static constexpr std::uint32_t kId = 262;
  static constexpr std::string_view kName = "CAMERA_CAPTURE_STATUS";
  static constexpr int kBaseFields = 6;
  std::uint32_t time_boot_ms = 0;
  float image_interval = 0;  // s
  std::uint32_t recording_time_ms = 0;
  float available_capacity = 0;   // MiB
  std::uint8_t image_status = 0;  // 0 idle, 1 capturing, 2 interval set, 3 interval and capturing
  std::uint8_t video_status = 0;
  std::int32_t image_count = 0;
  std::uint8_t camera_device_id = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("time_boot_ms", m.time_boot_ms);
    f("image_interval", m.image_interval);
    f("recording_time_ms", m.recording_time_ms);
    f("available_capacity", m.available_capacity);
    f("image_status", m.image_status);
    f("video_status", m.video_status);
    f("image_count", m.image_count);
    f("camera_device_id", m.camera_device_id);
  }
};

struct CameraImageCaptured {
  static constexpr std::uint32_t kId = 263;
  static constexpr std::string_view kName = "CAMERA_IMAGE_CAPTURED";
  static constexpr int kBaseFields = 11;
  std::uint64_t time_utc = 0;  // us, Unix; 0: unknown
  std::uint32_t time_boot_ms = 0;
  std::int32_t lat = 0, lon = 0;
  std::int32_t alt = 0;           // mm above mean sea level
  std::int32_t relative_alt = 0;  // mm above home
  std::array<float, 4> q{};       // w, x, y, z of the camera in NED
  std::int32_t image_index = 0;
  std::uint8_t camera_id = 0;
  std::int8_t capture_result = 0;  // 1 success, 0 failure
  Text<205> file_url{};
  static constexpr void fields(auto& m, auto&& f) {
    f("time_utc", m.time_utc);
    f("time_boot_ms", m.time_boot_ms);
    f("lat", m.lat);
    f("lon", m.lon);
    f("alt", m.alt);
    f("relative_alt", m.relative_alt);
    f("q", m.q);
    f("image_index", m.image_index);
    f("camera_id", m.camera_id);
    f("capture_result", m.capture_result);
    f("file_url", m.file_url);
  }
};

struct GimbalDeviceAttitudeStatus {
  static constexpr std::uint32_t kId = 285;
  static constexpr std::string_view kName = "GIMBAL_DEVICE_ATTITUDE_STATUS";
  static constexpr int kBaseFields = 9;
  std::uint32_t time_boot_ms = 0;
  std::array<float, 4> q{};  // w, x, y, z; the camera mount (forward, right, down) in the frame of `flags`
  float angular_velocity_x = 0, angular_velocity_y = 0, angular_velocity_z = 0;
  std::uint32_t failure_flags = 0;
  std::uint16_t flags = 0;  // GIMBAL_DEVICE_FLAGS
  std::uint8_t target_system = 0, target_component = 0;
  float delta_yaw = 0;  // rad, vehicle heading against north; NaN: unknown
  float delta_yaw_velocity = 0;
  std::uint8_t gimbal_device_id = 0;
  static constexpr void fields(auto& m, auto&& f) {
    f("time_boot_ms", m.time_boot_ms);
    f("q", m.q);
    f("angular_velocity_x", m.angular_velocity_x);
    f("angular_velocity_y", m.angular_velocity_y);
    f("angular_velocity_z", m.angular_velocity_z);
    f("failure_flags", m.failure_flags);
    f("flags", m.flags);
    f("target_system", m.target_system);
    f("target_component", m.target_component);
    f("delta_yaw", m.delta_yaw);
    f("delta_yaw_velocity", m.delta_yaw_velocity);
    f("gimbal_device_id", m.gimbal_device_id);
  }
};

// Every message above.
using Messages = std::tuple<Heartbeat, SystemTime, GpsRawInt, Attitude, AttitudeQuaternion, GlobalPositionInt,
                            CommandLong, CommandAck, Timesync, CameraTrigger, CameraFeedback, Statustext,
                            CameraInformation, CameraSettings, StorageInformation, CameraCaptureStatus,
                            CameraImageCaptured, GimbalDeviceAttitudeStatus>;

}  // namespace overfly::mavlink
