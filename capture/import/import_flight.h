#pragma once
#include <filesystem>
#include <optional>

#include "capture/record/flight.h"
#include "config/error.h"

namespace overfly::capture {

struct ImportOptions {
  // flight.csv folders: false takes the adjusted poses, true what the device recorded (raw_* columns).
  bool raw = false;
  // Camera file to use instead of what the folder says: the layout of camera.json in a flight.csv folder.
  std::optional<std::filesystem::path> camera_file;
};

// Reads any folder that is understood, without writing to it:
//  - a recorded flight (docs/flight-format.md);
//  - flight.csv + camera.json + images/ (poses of a bundle adjustment, and what the device recorded);
//  - drone JPEGs (EXIF, XMP drone-dji and pix4d Camera tags).
// Where the device gave no attitude a frame has no pose, and what was said is kept in FlightFrame::raw.
// FlightInfo says the vertical datum that was assumed and why, and the notes what else was found or assumed.
// NotFound: no such folder; BadInput: nothing there that is understood, or nothing usable, with the reason.
[[nodiscard]] Result<Flight> importFlight(const std::filesystem::path& folder,
                                          const ImportOptions& options = {});

// Writes a flight into a new folder of the project's own format; frames whose image does not read are left
// out and named in the result's warnings. Returns what then lies there.
[[nodiscard]] Result<Flight> saveFlight(const Flight& flight, const std::filesystem::path& folder);

}  // namespace overfly::capture
