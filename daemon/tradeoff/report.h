#pragma once
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "config/error.h"
#include "daemon/tradeoff/trial.h"

namespace overfly::tradeoff {

// All trials on one flight.
struct ReportSection {
  std::string name;       // of the flight or scene
  std::string reference;  // what its errors are measured against
  std::vector<Trial> trials;
};

struct Report {
  std::string command;                                       // that makes it again
  std::vector<std::pair<std::string, std::string>> machine;  // what, value: device, driver, program, settings
  std::vector<ReportSection> sections;
};

// report.html (everything in one file, dark and light), tradeoff.csv and tradeoff.json in `folder`, which is
// made when it is not there. Io when they cannot be written.
[[nodiscard]] Result<void> writeReport(const Report& report, const std::filesystem::path& folder);

[[nodiscard]] std::string csvOf(const Report& report);
[[nodiscard]] std::string jsonOf(const Report& report);
[[nodiscard]] std::string htmlOf(const Report& report);

}  // namespace overfly::tradeoff
