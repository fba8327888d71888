#pragma once
#include <optional>
#include <string>
#include <vector>

#include "capture/record/flight.h"

namespace overfly::capture {

// What a flight saw of a plane of one height, in the flight's datum.
struct Survey {
  double ground_height_m = 0;
  std::string ground_reason;
  std::size_t frames_with_footprint = 0;
  std::vector<std::string> refused;  // frames without one, and why
  double gsd_m = 0;                  // median over the frames, at their centres
  double area_m2 = 0;                // seen by at least one frame
  double area3_m2 = 0;               // by at least three
  double mean_overlap = 0;           // frames over a point that any frame sees
  // Share of a footprint that the next frame (in time) sees too, where any is shared: median.
  std::optional<double> forward_overlap;
  // The largest share that a frame of another strip sees: median. A strip ends where the course turns by more
  // than 60 degrees.
  std::optional<double> sideways_overlap;
  int strips = 0;
};

// Counts on a grid of some ten thousand cells over the footprints. Without `ground_height_m` the flight's own
// is taken. Unavailable: no pose, or no ground height. Reentrant.
[[nodiscard]] Result<Survey> surveyFlight(const Flight& flight, std::optional<double> ground_height_m = {});

}  // namespace overfly::capture
