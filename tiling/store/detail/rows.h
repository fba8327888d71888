#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tiling/store/detail/sqlite.h"
#include "tiling/store/map_store.h"

namespace overfly::tiling::detail {

inline constexpr int kSpaceLattice = 0;
inline constexpr int kSpaceTop = 1;

// CRC-32 of a layer's place and bytes, as docs/tile-store.md says.
[[nodiscard]] std::uint32_t checksum(int space, const geo::TileKey& key, Layer layer, Codec codec,
                                     std::uint64_t revision, std::span<const std::uint8_t> bytes);

[[nodiscard]] constexpr std::int64_t layerRow(std::int64_t tile, Layer layer) {
  return tile * 256 + static_cast<std::int64_t>(layer);
}

// Ids ascending, without repetition, as varints of the differences.
[[nodiscard]] std::vector<std::uint8_t> packFrameSet(std::vector<std::uint64_t> ids);
[[nodiscard]] std::optional<std::vector<std::uint64_t>> unpackFrameSet(std::span<const std::uint8_t> bytes);

[[nodiscard]] std::string cameraText(const capture::CameraModel& camera);
[[nodiscard]] std::optional<capture::CameraModel> cameraFromText(const std::string& text);

// The columns that a frame is read by, camera.model joined last.
inline constexpr std::string_view kFrameColumns =
    "frame.id, name, camera_id, time_ns, utc_offset_ns, exposure_ns, datum, pose_is_adjusted, pose, "
    "footprint, "
    "west, north, east, south, path, bytes, state, reason, camera.model";
[[nodiscard]] Result<FrameRecord> frameFromRow(const Query& row);
[[nodiscard]] Result<void> writeFrame(Database& database, const FrameRecord& frame);

}  // namespace overfly::tiling::detail
