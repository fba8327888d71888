#pragma once
#include <optional>
#include <vector>

#include "capture/pose.h"
#include "render/scene/flight_path.h"
#include "render/scene/world.h"

namespace overfly::scene {

// What happens to each frame of a flight before anybody sees it: the pose as the drone would record it beside
// the exact one, and what the stream does to it.
struct PlannedFrame {
  int frame = 0;                          // of the path
  double time_s = 0;                      // from the flight's start
  capture::Pose exact;                    // time_ns 0: the source sets it
  std::optional<capture::Pose> recorded;  // with the pose effects and their covariance; absent: lost
  int picture = 0;    // whose picture it carries: its own, or an earlier frame's (duplicated)
  double late_s = 0;  // handed on so long after its time
};

struct FlightPlan {
  std::vector<PlannedFrame> frames;  // lost ones are left out: gaps in `frame`
  bool poses_are_exact = true;       // no pose effect is named
};

// Deterministic: the scene's effects, each with its own random stream.
[[nodiscard]] FlightPlan planFlight(const World& world, const FlightPath& path);

}  // namespace overfly::scene
