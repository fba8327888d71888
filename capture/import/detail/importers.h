#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "capture/import/import_flight.h"

// One function per kind of folder; importFlight() chooses.
namespace overfly::capture::detail {

// flight.csv + camera.json + images/.
[[nodiscard]] Result<Flight> importCsv(const std::filesystem::path& folder, const ImportOptions& options);

// JPEGs with EXIF and XMP, in the folder itself or in images/.
[[nodiscard]] Result<Flight> importJpegs(const std::filesystem::path& folder, const ImportOptions& options);
[[nodiscard]] std::vector<std::filesystem::path> jpegsIn(const std::filesystem::path& folder);

// The ground's height as the take-off point, where the device gave absolute and relative altitudes.
void groundFromTakeOff(const std::vector<FlightFrame>& frames, FlightInfo& info);

// What was wrong with single frames: the first hundred sentences, and how many.
struct Skips {
  std::vector<std::string> warnings;
  std::size_t count = 0;
  void add(std::string why) {
    ++count;
    if (warnings.size() < 100) warnings.push_back(std::move(why));
  }
};

}  // namespace overfly::capture::detail
