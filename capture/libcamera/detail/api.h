#pragma once
#include <libcamera/camera.h>
#include <libcamera/camera_manager.h>
#include <libcamera/control_ids.h>
#include <libcamera/property_ids.h>
#include <libcamera/version.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

// Everything of libcamera's interface that differs between its releases, from 0.0.3 (Debian 12) on; no other
// file looks at the version.
#define OVERFLY_LIBCAMERA_AT_LEAST(major, minor) \
  (LIBCAMERA_VERSION_MAJOR > (major) ||          \
   (LIBCAMERA_VERSION_MAJOR == (major) && LIBCAMERA_VERSION_MINOR >= (minor)))

namespace overfly::capture::lc {

// Which of the two the number is was told apart only from 0.5 on: before, automatic exposure was one switch
// for both.
inline void setAutomatic(libcamera::ControlList& controls, const libcamera::ControlInfoMap& known,
                         bool exposure, bool gain) {
  using namespace libcamera;
#if OVERFLY_LIBCAMERA_AT_LEAST(0, 5)
  if (known.count(&controls::ExposureTimeMode) != 0)
    controls.set(controls::ExposureTimeMode,
                 exposure ? controls::ExposureTimeModeAuto : controls::ExposureTimeModeManual);
  if (known.count(&controls::AnalogueGainMode) != 0)
    controls.set(controls::AnalogueGainMode,
                 gain ? controls::AnalogueGainModeAuto : controls::AnalogueGainModeManual);
#else
  if (known.count(&controls::AeEnable) != 0) controls.set(controls::AeEnable, exposure || gain);
#endif
}

// A list that only takes controls that the camera knows.
inline libcamera::ControlList controlsFor(const libcamera::Camera& camera) {
  return libcamera::ControlList(camera.controls());
}

inline std::string modelOf(const libcamera::Camera& camera) {
  const auto model = camera.properties().get(libcamera::properties::Model);
  return model ? std::string(*model) : std::string();
}

// ids of controls::ExposureTime, AnalogueGain, SensorTimestamp as the request's metadata says them.
template <typename T>
std::optional<T> metadataOf(libcamera::Request& request, const libcamera::Control<T>& control) {
  return request.metadata().get(control);
}

}  // namespace overfly::capture::lc
