#include "capture/import/import_flight.h"

#include <fmt/format.h>

#include <algorithm>

#include "capture/import/detail/importers.h"
#include "capture/record/recorder.h"

namespace overfly::capture {

namespace detail {

void groundFromTakeOff(const std::vector<FlightFrame>& frames, FlightInfo& info) {
  std::vector<double> heights;
  for (const FlightFrame& frame : frames) {
    if (frame.raw && frame.raw->altitude_m && frame.raw->relative_altitude_m) {
      heights.push_back(*frame.raw->altitude_m - *frame.raw->relative_altitude_m);
    }
  }
  if (heights.empty()) return;
  const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
  std::nth_element(heights.begin(), middle, heights.end());
  info.ground_height_m = *middle;
  info.ground_reason = "the take-off point: recorded altitude less recorded relative altitude";
}

}  // namespace detail

Result<Flight> importFlight(const std::filesystem::path& folder, const ImportOptions& options) {
  std::error_code code;
  if (!std::filesystem::exists(folder, code)) {
    return fail(ErrorCode::NotFound, fmt::format("{} does not exist", folder.string()));
  }
  if (!std::filesystem::is_directory(folder, code)) {
    return fail(ErrorCode::BadInput, fmt::format("{} is not a folder", folder.string()));
  }
  if (std::filesystem::exists(folder / "flight.json", code)) {
    if (options.raw) {
      return fail(ErrorCode::BadInput,
                  fmt::format("{} is a recorded flight: its poses are one set, and \"raw\" does "
                              "not apply",
                              folder.string()));
    }
    return Flight::open(folder);
  }
  if (std::filesystem::exists(folder / "flight.csv", code)) return detail::importCsv(folder, options);
  if (!detail::jpegsIn(folder).empty()) return detail::importJpegs(folder, options);
  return fail(ErrorCode::BadInput,
              fmt::format("{} holds neither flight.json (a recorded flight) nor flight.csv nor JPEG files",
                          folder.string()));
}

Result<Flight> saveFlight(const Flight& flight, const std::filesystem::path& folder) {
  auto recorder = FlightRecorder::create(folder, flight.info());
  if (!recorder) return tl::unexpected(recorder.error());
  detail::Skips skips;
  for (std::size_t i = 0; i < flight.size(); ++i) {
    const auto frame = flight.load(i);
    if (!frame) {
      skips.add(frame.error().message);
      continue;
    }
    auto done = recorder->record(**frame, flight.at(i).raw);
    if (!done && done.error().code == ErrorCode::Io) return tl::unexpected(done.error());
    if (!done) skips.add(fmt::format("{}: {}", flight.at(i).frame.name, done.error().message));
  }
  if (auto done = recorder->close(); !done) return tl::unexpected(done.error());
  auto saved = Flight::open(folder);
  if (!saved) return saved;
  std::vector<std::string> warnings = flight.warnings();
  warnings.insert(warnings.end(), skips.warnings.begin(), skips.warnings.end());
  return Flight(saved->info(), saved->cameras(), saved->frames(), std::move(warnings),
                flight.skipped() + skips.count + saved->skipped());
}

}  // namespace overfly::capture
