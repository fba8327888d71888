#include "capture/pose/camera_component.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace overfly::capture {
namespace {

constexpr std::size_t kKept = 256;

// MAV_CMD
constexpr std::uint16_t kRequestMessage = 512, kRequestCameraInformation = 521, kRequestCameraSettings = 522,
                        kRequestStorageInformation = 525, kRequestCameraCaptureStatus = 527,
                        kRequestCameraImageCapture = 2002;
// MAV_RESULT
constexpr std::uint8_t kAccepted = 0, kDenied = 2, kUnsupported = 3;

float known(double value) {
  return value > 0 ? static_cast<float>(value) : std::numeric_limits<float>::quiet_NaN();
}

std::uint16_t clamped(int value) { return static_cast<std::uint16_t>(std::clamp(value, 0, 65535)); }

}  // namespace

std::vector<OutgoingMessage> CameraComponent::answer(const mavlink::CommandLong& command,
                                                     mavlink::Address from, std::uint32_t boot_ms) const {
  const bool to_system = command.target_system == 0 || command.target_system == self_.system;
  const bool to_us = to_system && command.target_component == self_.component;
  const bool to_all = to_system && command.target_component == 0;
  if (!to_us && !to_all) return {};
  std::optional<std::uint32_t> wanted;
  double which = command.param2;
  switch (command.command) {
    case kRequestMessage:
      if (command.param1 >= 0 && command.param1 < 16777216.0F)
        wanted = static_cast<std::uint32_t>(command.param1);
      break;
    case kRequestCameraInformation:
      wanted = mavlink::CameraInformation::kId;
      break;
    case kRequestCameraSettings:
      wanted = mavlink::CameraSettings::kId;
      break;
    case kRequestStorageInformation:
      wanted = mavlink::StorageInformation::kId;
      which = command.param1;
      break;
    case kRequestCameraCaptureStatus:
      wanted = mavlink::CameraCaptureStatus::kId;
      break;
    case kRequestCameraImageCapture:
      wanted = mavlink::CameraImageCaptured::kId;
      which = command.param1;
      break;
    default:
      break;
  }
  mavlink::CommandAck ack;
  ack.command = command.command;
  ack.target_system = from.system;
  ack.target_component = from.component;
  ack.result = kUnsupported;
  auto reply = wanted ? message(*wanted, which, boot_ms) : std::nullopt;
  const bool known_image = wanted == mavlink::CameraImageCaptured::kId;
  if (reply) ack.result = kAccepted;
  if (!reply && known_image) ack.result = kDenied;
  // What is said to everybody and is not ours to do is left to others.
  if (!to_us && ack.result == kUnsupported) return {};
  std::vector<OutgoingMessage> out{ack};
  if (reply) out.push_back(std::move(*reply));
  return out;
}

std::optional<OutgoingMessage> CameraComponent::message(std::uint32_t id, double which,
                                                        std::uint32_t boot_ms) const {
  switch (id) {
    case mavlink::Heartbeat::kId: {
      mavlink::Heartbeat m;
      m.type = 30;          // MAV_TYPE_CAMERA
      m.autopilot = 8;      // MAV_AUTOPILOT_INVALID: no flight controller
      m.system_status = 4;  // MAV_STATE_ACTIVE
      return m;
    }
    case mavlink::CameraInformation::kId: {
      mavlink::CameraInformation m;
      m.time_boot_ms = boot_ms;
      mavlink::setText(m.vendor_name, facts_.vendor);
      mavlink::setText(m.model_name, facts_.model);
      m.resolution_h = clamped(facts_.width);
      m.resolution_v = clamped(facts_.height);
      m.focal_length = known(facts_.focal_length_mm);
      m.sensor_size_h = known(facts_.sensor_width_mm);
      m.sensor_size_v = known(facts_.sensor_height_mm);
      return m;
    }
    case mavlink::CameraSettings::kId: {
      mavlink::CameraSettings m;
      m.time_boot_ms = boot_ms;
      m.mode_id = 2;  // CAMERA_MODE_IMAGE_SURVEY
      m.zoom_level = m.focus_level = std::numeric_limits<float>::quiet_NaN();
      return m;
    }
    case mavlink::StorageInformation::kId: {
      if (which > 1) return std::nullopt;  // 0: all; we have one
      mavlink::StorageInformation m;
      m.time_boot_ms = boot_ms;
      m.storage_id = m.storage_count = 1;
      m.status = facts_.disk_total_mib > 0 ? 2 : 3;  // ready, not supported
      m.total_capacity = static_cast<float>(facts_.disk_total_mib);
      m.available_capacity = static_cast<float>(facts_.disk_free_mib);
      m.used_capacity = static_cast<float>(std::max(0.0, facts_.disk_total_mib - facts_.disk_free_mib));
      mavlink::setText(m.name, "flights");
      return m;
    }
    case mavlink::CameraCaptureStatus::kId: {
      mavlink::CameraCaptureStatus m;
      m.time_boot_ms = boot_ms;
      m.image_interval = static_cast<float>(facts_.interval_s);
      m.image_status = facts_.capturing ? 3 : 0;
      m.available_capacity = static_cast<float>(facts_.disk_free_mib);
      m.image_count = count_;
      return m;
    }
    case mavlink::CameraImageCaptured::kId: {
      const auto found =
          std::find_if(recent_.begin(), recent_.end(), [&](const mavlink::CameraImageCaptured& image) {
            return static_cast<double>(image.image_index) == which;
          });
      if (found == recent_.end()) return std::nullopt;
      return *found;
    }
    default:
      return std::nullopt;
  }
}

mavlink::CameraImageCaptured CameraComponent::captured(mavlink::CameraImageCaptured image) {
  image.image_index = count_++;
  image.capture_result = 1;
  recent_.push_back(image);
  if (recent_.size() > kKept) recent_.pop_front();
  return image;
}

}  // namespace overfly::capture
