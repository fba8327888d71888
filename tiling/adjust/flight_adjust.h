#pragma once
#include <functional>
#include <string>
#include <vector>

#include "capture/record/flight.h"
#include "config/error.h"
#include "tiling/adjust/adjuster.h"
#include "tiling/adjust/control_file.h"

namespace overfly::tiling::adjust {

// One camera's part of an adjusted flight.
struct CameraAdjustment {
  std::string camera_id;
  capture::CameraModel nominal, adjusted;
  PoseMap::Summary summary;
  std::vector<Adjuster::ControlResidual> control;
};

struct FlightAdjustment {
  struct FrameResult {
    std::size_t index = 0;  // in the flight
    AdjustedPose pose;      // state, reason and figures; the pose itself where there is one
    std::string assumed;    // about the telemetry, see TelemetryPrior
  };
  std::vector<FrameResult> frames;  // one per frame of the flight, in its order
  std::vector<CameraAdjustment> cameras;
  // The flight with the adjusted poses and cameras: frames that were not adjusted have their telemetry's pose
  // where that is good enough for a sweep (FrameState::PriorOnly), else none.
  capture::Flight flight;
};

struct FlightAdjustOptions {
  AdjusterOptions adjuster;
  std::vector<ControlEntry> control;
  std::function<void(std::size_t done, const std::string& name)> progress;  // after each frame
};

// Adjusts a whole flight on the ground: all frames in order, then all together. Begins from what the device
// recorded (FlightFrame::raw) where it is kept, else from the frames' poses. Each camera of the flight is
// adjusted by itself. BadInput: no frame with image and position.
[[nodiscard]] Result<FlightAdjustment> adjustFlight(const capture::Flight& flight,
                                                    const FlightAdjustOptions& options);

}  // namespace overfly::tiling::adjust
