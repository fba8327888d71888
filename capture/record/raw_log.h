#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <variant>
#include <vector>

#include "config/error.h"

namespace overfly::capture {

// The raw inputs of a flight (docs/flight-format.md, raw.log): kept so that a delay, a clock or a rolling
// shutter can be studied again. Times: CLOCK_BOOTTIME, nanoseconds.
struct TelemetryPacket {
  std::int64_t time_ns = 0;  // of arrival
  std::uint8_t channel = 0;  // which link it came by
  std::vector<std::uint8_t> bytes;
  friend bool operator==(const TelemetryPacket&, const TelemetryPacket&) = default;
};

struct GpioEdge {
  std::int64_t time_ns = 0;  // when the recorder had it
  std::uint32_t line = 0;
  bool rising = true;
  std::uint32_t line_sequence = 0;  // the kernel's, gaps mean lost edges
  std::int64_t edge_ns = 0;         // the kernel's time stamp of the edge
  friend bool operator==(const GpioEdge&, const GpioEdge&) = default;
};

enum class DeviceClock : std::uint8_t { UtcByPps = 0, AutopilotBoot = 1, Camera = 2 };

struct ClockPair {
  std::int64_t time_ns = 0;  // when the recorder had it
  DeviceClock clock = DeviceClock::UtcByPps;
  std::int64_t device_ns = 0;       // the device's clock ...
  std::int64_t boottime_ns = 0;     // ... and ours at the same instant
  std::int64_t uncertainty_ns = 0;  // of the pairing
  friend bool operator==(const ClockPair&, const ClockPair&) = default;
};

using RawInput = std::variant<TelemetryPacket, GpioEdge, ClockPair>;

// One record as it stands in the file. BadInput: a packet longer than 65,535 bytes.
[[nodiscard]] Result<std::vector<std::uint8_t>> encodeRawInput(const RawInput& input);

struct RawLog {
  std::vector<RawInput> inputs;  // in the order of writing
  std::size_t skipped = 0;       // records with a wrong checksum or an unknown kind
  std::uint64_t cut_bytes = 0;   // unreadable bytes at the end: the record that was being written
};

// NotFound: the flight has no raw.log; Corrupt: it does not begin as one.
[[nodiscard]] Result<RawLog> readRawLog(const std::filesystem::path& flight_folder);

}  // namespace overfly::capture
