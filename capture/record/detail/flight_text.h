#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "capture/record/flight.h"

// Flight values to and from the text of docs/flight-format.md.
namespace overfly::capture::detail {

inline constexpr int kVersion = 1;
inline constexpr std::size_t kMaxLine = 65536;
inline constexpr std::uint64_t kMaxImageBytes = 256u << 20;

[[nodiscard]] std::string infoText(const FlightInfo& info);
[[nodiscard]] Result<FlightInfo> infoFromText(const std::string& text);

[[nodiscard]] std::string camerasText(const std::vector<FlightCamera>& cameras);
[[nodiscard]] Result<std::vector<FlightCamera>> camerasFromText(const std::string& text);

// A line with its checksum and line feed. `file` is the image's name under images/.
[[nodiscard]] std::string frameLine(const Frame& frame, int camera_revision, const std::string& file,
                                    std::uint64_t bytes, std::uint32_t crc, const TelemetryPtr& raw);

// The inverse, for a line without its line feed; the message of an error says what is wrong with the line.
[[nodiscard]] Result<FlightFrame> frameFromLine(std::string_view line,
                                                const std::vector<FlightCamera>& cameras, VerticalDatum datum,
                                                const std::filesystem::path& images);

// True when the name can be a file's under images/: no folder in it, not hidden, plain characters.
[[nodiscard]] bool isPlainFileName(std::string_view name);

}  // namespace overfly::capture::detail
