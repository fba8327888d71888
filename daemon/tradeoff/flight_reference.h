#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "capture/record/flight.h"
#include "config/error.h"
#include "tiling/accuracy/accuracy.h"

namespace overfly::tradeoff {

// A flight, and points on its ground whose heights are known from elsewhere.
struct FlightReference {
  std::string name;
  capture::Flight flight;
  std::vector<tiling::ReferencePoint> points;
  int strong_track = 0;   // frames that must see a point to count; 0: the mean
  std::string reference;  // what the points are, for a person
};

// A recorded flight with reference_points.csv. NotFound without them.
[[nodiscard]] Result<FlightReference> recordedReference(const std::filesystem::path& folder);

// A simulated flight: its first `frames` frames (0: all) are recorded into `folder`, and `points` places on
// ground that at least three of them see are asked of the scene's truth.
[[nodiscard]] Result<FlightReference> simulatedReference(const std::string& scene_file_or_name,
                                                         const std::filesystem::path& folder, int frames,
                                                         std::size_t points, std::uint64_t seed = 1);

}  // namespace overfly::tradeoff
