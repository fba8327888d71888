#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "capture/pose.h"
#include "capture/record/flight.h"

namespace overfly::tiling::adjust {

// A first pose from what a device recorded, and what had to be assumed for it.
struct TelemetryPrior {
  std::optional<capture::Pose> pose;  // absent without latitude and longitude
  std::string assumed;                // "course and nadir, no altitude"; empty when nothing was
};

// A covariance that was left at zero says nothing: it gets the claims of a single receiver (3 m) and a gimbal
// (2 degrees, heading 5).
void fillCovariance(capture::Pose& pose);

// Poses to begin an adjustment from, one per frame, in the given (time) order. Claimed 1 sigma where the
// device says none: 5 m horizontally; 3 m vertically with a barometric height, else 30 m; attitude of a
// gimbal 2 degrees in tilt and 5 in heading, of a body 5 and 10. Without attitude the camera is taken to look
// straight down (10 degrees) with its top along the course over ground (45 degrees). The adjustment
// re-estimates this noise; the claims only have to be of the right order.
[[nodiscard]] std::vector<TelemetryPrior> priorsFromTelemetry(std::span<const capture::FlightFrame> frames);

}  // namespace overfly::tiling::adjust
