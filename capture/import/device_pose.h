#pragma once
#include <cstdint>
#include <optional>

#include "capture/pose.h"
#include "capture/record/flight.h"

namespace overfly::capture {

// How well a device knows where it is and how it looks when it does not say so itself. 1 sigma.
struct DeviceAccuracy {
  double horizontal_m = 2.0;  // a code-phase receiver under open sky
  double vertical_m = 2.0;    // the same, smoothed by a barometer; a constant offset comes on top
  double tilt = 0.035;        // 2 degrees: gimbal to pixels, without calibration
  double heading = 0.087;     // 5 degrees: compass
};

// The pose that a device's own words amount to: position, and the gimbal's attitude. nullopt without a
// position, an altitude or a complete gimbal attitude: nothing is made up.
[[nodiscard]] std::optional<Pose> devicePose(const RawTelemetry& raw, std::int64_t time_ns,
                                             const DeviceAccuracy& accuracy = {});

}  // namespace overfly::capture
