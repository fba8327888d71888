#include "capture/record/raw_log.h"

#include <fmt/format.h>

#include <cstring>
#include <optional>
#include <span>

#include "capture/record/files.h"

namespace overfly::capture {
namespace {

constexpr std::string_view kMagic = "OVFRAW1\n";
constexpr std::size_t kHeader = 4 + 1 + 8;  // length, kind, time
constexpr std::size_t kMaxPayload = 65536;
constexpr std::uint64_t kMaxFile = 512u << 20;   // hours of telemetry
constexpr std::size_t kMaxDamagedInARow = 1000;  // after which the rest is taken for no log at all
enum Kind : std::uint8_t { kTelemetry = 1, kEdge = 2, kClock = 3 };

template <typename T>
void put(std::vector<std::uint8_t>& out, T value) {
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    out.push_back(static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i)));
  }
}

template <typename T>
T get(std::span<const std::uint8_t>& in) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) value |= std::uint64_t{in[i]} << (8 * i);
  in = in.subspan(sizeof(T));
  return static_cast<T>(value);
}

struct Encoded {
  Kind kind;
  std::int64_t time_ns;
  std::vector<std::uint8_t> payload;
};

Encoded payloadOf(const TelemetryPacket& packet) {
  Encoded encoded{kTelemetry, packet.time_ns, {packet.channel}};
  encoded.payload.insert(encoded.payload.end(), packet.bytes.begin(), packet.bytes.end());
  return encoded;
}

Encoded payloadOf(const GpioEdge& edge) {
  Encoded encoded{kEdge, edge.time_ns, {}};
  put(encoded.payload, edge.line);
  put(encoded.payload, static_cast<std::uint8_t>(edge.rising));
  put(encoded.payload, edge.line_sequence);
  put(encoded.payload, edge.edge_ns);
  return encoded;
}

Encoded payloadOf(const ClockPair& pair) {
  Encoded encoded{kClock, pair.time_ns, {}};
  put(encoded.payload, static_cast<std::uint8_t>(pair.clock));
  put(encoded.payload, pair.device_ns);
  put(encoded.payload, pair.boottime_ns);
  put(encoded.payload, pair.uncertainty_ns);
  return encoded;
}

std::optional<RawInput> inputFrom(std::uint8_t kind, std::int64_t time_ns, std::span<const std::uint8_t> in) {
  if (kind == kTelemetry && !in.empty()) {
    TelemetryPacket packet;
    packet.time_ns = time_ns;
    packet.channel = get<std::uint8_t>(in);
    packet.bytes.assign(in.begin(), in.end());
    return packet;
  }
  if (kind == kEdge && in.size() == 17) {
    GpioEdge edge;
    edge.time_ns = time_ns;
    edge.line = get<std::uint32_t>(in);
    edge.rising = get<std::uint8_t>(in) != 0;
    edge.line_sequence = get<std::uint32_t>(in);
    edge.edge_ns = get<std::int64_t>(in);
    return edge;
  }
  if (kind == kClock && in.size() == 25 && in[0] <= static_cast<std::uint8_t>(DeviceClock::Camera)) {
    ClockPair pair;
    pair.time_ns = time_ns;
    pair.clock = static_cast<DeviceClock>(get<std::uint8_t>(in));
    pair.device_ns = get<std::int64_t>(in);
    pair.boottime_ns = get<std::int64_t>(in);
    pair.uncertainty_ns = get<std::int64_t>(in);
    return pair;
  }
  return std::nullopt;
}

}  // namespace

Result<std::vector<std::uint8_t>> encodeRawInput(const RawInput& input) {
  const Encoded encoded = std::visit([](const auto& value) { return payloadOf(value); }, input);
  if (encoded.payload.size() > kMaxPayload) {
    return fail(ErrorCode::BadInput,
                fmt::format("a raw input of {} bytes is too long to keep", encoded.payload.size()));
  }
  std::vector<std::uint8_t> record;
  record.reserve(kHeader + encoded.payload.size() + 4);
  put(record, static_cast<std::uint32_t>(encoded.payload.size()));
  put(record, static_cast<std::uint8_t>(encoded.kind));
  put(record, encoded.time_ns);
  record.insert(record.end(), encoded.payload.begin(), encoded.payload.end());
  put(record, crc32Of(record));
  return record;
}

Result<RawLog> readRawLog(const std::filesystem::path& flight_folder) {
  const auto path = flight_folder / "raw.log";
  const auto content = readFile(path, kMaxFile);
  if (!content) return tl::unexpected(content.error());
  RawLog log;
  std::span<const std::uint8_t> rest = *content;
  if (rest.size() < kMagic.size()) {  // killed before the first eight bytes were there
    log.cut_bytes = rest.size();
    return log;
  }
  if (std::memcmp(rest.data(), kMagic.data(), kMagic.size()) != 0) {
    return fail(ErrorCode::Corrupt, path.string() + " does not begin as a raw log");
  }
  rest = rest.subspan(kMagic.size());
  std::size_t damaged = 0;
  while (rest.size() >= kHeader + 4 && damaged < kMaxDamagedInARow) {
    std::span<const std::uint8_t> header = rest;
    const auto length = get<std::uint32_t>(header);
    const auto kind = get<std::uint8_t>(header);
    const auto time_ns = get<std::int64_t>(header);
    if (length > kMaxPayload || rest.size() < kHeader + length + 4) break;
    std::span<const std::uint8_t> checksum = rest.subspan(kHeader + length);
    const bool whole = get<std::uint32_t>(checksum) == crc32Of(rest.first(kHeader + length));
    auto input = whole ? inputFrom(kind, time_ns, rest.subspan(kHeader, length)) : std::nullopt;
    if (input) {
      log.inputs.push_back(std::move(*input));
      damaged = 0;
    } else {
      ++log.skipped;
      ++damaged;
    }
    rest = rest.subspan(kHeader + length + 4);
  }
  log.cut_bytes = rest.size();
  return log;
}

}  // namespace overfly::capture
