#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "config/error.h"
#include "daemon/tradeoff/trial.h"

namespace overfly::tradeoff {

// Adjusts a flight from its raw telemetry with several numbers of features, kinds and windows, and compares
// with the poses that the flight's file gives as adjusted: mean distance of the camera centres after a
// similarity, metres, and of the viewing directions, degrees. Time is per frame. NotFound when the flight
// has no raw telemetry or no adjusted poses to compare with.
[[nodiscard]] Result<std::vector<Trial>> tryAdjustment(
    const std::filesystem::path& flight, bool quick,
    const std::function<void(std::size_t done, std::size_t total, const std::string&)>& progress);

}  // namespace overfly::tradeoff
