#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "capture/frame.h"
#include "capture/geo/geodetic.h"
#include "config/error.h"

namespace overfly::capture {

// What a device wrote about one frame, before anybody interpreted it: kept for a later adjustment.
// Radians and metres; heights in the flight's datum; yaw from north, clockwise; aerospace order Z-Y'-X''.
struct RawTelemetry {
  std::optional<double> lat, lon;
  std::optional<double> altitude_m;           // as the device's absolute altitude
  std::optional<double> relative_altitude_m;  // above the take-off point
  std::optional<double> gimbal_yaw, gimbal_pitch, gimbal_roll;
  std::optional<double> body_yaw, body_pitch, body_roll;
  std::optional<double> std_north_m, std_east_m, std_up_m;  // the receiver's own 1-sigma (RTK)

  [[nodiscard]] bool empty() const { return *this == RawTelemetry{}; }
  friend bool operator==(const RawTelemetry&, const RawTelemetry&) = default;
};
using TelemetryPtr = std::shared_ptr<const RawTelemetry>;  // null: none was recorded

// What holds for a flight as a whole.
struct FlightInfo {
  std::string made_by;  // program that wrote or imported it
  std::string source;   // what it was recorded or imported from
  VerticalDatum datum = VerticalDatum::Unknown;
  std::string geoid_model;                // with VerticalDatum::Geoid
  std::string datum_reason;               // why this datum: for a person
  std::optional<geo::Geodetic> origin;    // of a local frame that the flight's files used
  std::optional<double> ground_height_m;  // typical ground, in the flight's datum
  std::string ground_reason;
  std::string boot_id;             // whose CLOCK_BOOTTIME the times are
  std::vector<std::string> notes;  // what an importer found or assumed, one sentence each
};

struct FlightCamera {
  std::string id;
  int revision = 0;
  CameraModel model;
};

// One frame of a flight: everything but its pixels.
struct FlightFrame {
  Frame frame;       // image.bytes is empty; image's format and size are what the table or camera says
  std::string file;  // path of the image
  std::optional<std::uint64_t> bytes;  // size of the file as recorded
  std::optional<std::uint32_t> crc;    // CRC-32 of the file as recorded
  TelemetryPtr raw;
};

// A flight that lies on a disk: its table in memory, its images read when asked for. Frames are in time
// order, strictly increasing for each camera. The folder is never written to. Value type; const methods are
// reentrant.
class Flight {
 public:
  // Reads a folder of the project's own format (docs/flight-format.md). NotFound: no flight.json there;
  // Unsupported: a newer format; Corrupt: flight.json or cameras.json do not read. Lines that cannot be used
  // are skipped, see warnings(). importFlight() reads other folders too.
  [[nodiscard]] static Result<Flight> open(const std::filesystem::path& folder);

  // Puts a flight together; frames are sorted, and those whose time does not increase are skipped.
  Flight(FlightInfo info, std::vector<FlightCamera> cameras, std::vector<FlightFrame> frames,
         std::vector<std::string> warnings, std::size_t skipped);

  [[nodiscard]] const FlightInfo& info() const { return info_; }
  [[nodiscard]] const std::vector<FlightCamera>& cameras() const { return cameras_; }
  [[nodiscard]] std::size_t size() const { return frames_.size(); }
  [[nodiscard]] const FlightFrame& at(std::size_t index) const { return frames_.at(index); }
  [[nodiscard]] const std::vector<FlightFrame>& frames() const { return frames_; }

  // The frame with its image. NotFound: no such file; Corrupt: not the bytes that were recorded; BadInput:
  // not an image, or of another size than its camera.
  [[nodiscard]] Result<FramePtr> load(std::size_t index) const;

  // Why frames were skipped or doubted, one sentence each (the first hundred).
  [[nodiscard]] const std::vector<std::string>& warnings() const { return warnings_; }
  [[nodiscard]] std::size_t skipped() const { return skipped_; }

 private:
  FlightInfo info_;
  std::vector<FlightCamera> cameras_;
  std::vector<FlightFrame> frames_;
  std::vector<std::string> warnings_;
  std::size_t skipped_ = 0;
};

[[nodiscard]] const char* nameOf(VerticalDatum datum);
[[nodiscard]] const char* nameOf(PixelFormat format);
[[nodiscard]] const char* nameOf(CameraModel::Kind kind);

}  // namespace overfly::capture
