#include "tiling/store/codec_planes.h"

#include <cstring>

#include "tiling/store/detail/compress.h"

namespace overfly::tiling {
namespace {

// 'P', number of planes, side (16 bit); then per plane the frame's length (32 bit) and the zstd frame.
constexpr std::size_t kHeaderBytes = 4;
constexpr std::size_t kMostPlanes = 32;

}  // namespace

Result<std::vector<std::uint8_t>> encodePlanes(std::span<const std::span<const std::uint8_t>> planes,
                                               int size, int zstd_level) {
  const std::size_t count = static_cast<std::size_t>(size) * static_cast<std::size_t>(size);
  if (size < 1 || size > 4096 || planes.size() > kMostPlanes)
    return fail(ErrorCode::BadInput, "these are no planes of a tile");
  std::vector<std::uint8_t> bytes{'P', static_cast<std::uint8_t>(planes.size()),
                                  static_cast<std::uint8_t>(size), static_cast<std::uint8_t>(size >> 8)};
  for (const std::span<const std::uint8_t> plane : planes) {
    if (plane.size() != count) return fail(ErrorCode::BadInput, "the planes of a tile differ in size");
    const std::size_t length_at = bytes.size();
    bytes.resize(length_at + 4);
    if (const Result<void> done = detail::compress(plane, zstd_level, bytes); !done)
      return tl::unexpected(done.error());
    const auto length = static_cast<std::uint32_t>(bytes.size() - length_at - 4);
    std::memcpy(bytes.data() + length_at, &length, sizeof length);
  }
  bytes.shrink_to_fit();
  return bytes;
}

Result<std::vector<std::vector<std::uint8_t>>> decodePlanes(std::span<const std::uint8_t> bytes, int size) {
  const auto damaged = [] { return fail(ErrorCode::Corrupt, "the coded quality planes are damaged"); };
  if (size < 1 || size > 4096) return damaged();
  const std::size_t count = static_cast<std::size_t>(size) * static_cast<std::size_t>(size);
  if (bytes.size() < kHeaderBytes || bytes[0] != 'P' || bytes[1] > kMostPlanes ||
      (bytes[2] | bytes[3] << 8) != size)
    return damaged();
  std::vector<std::vector<std::uint8_t>> planes(bytes[1]);
  std::span<const std::uint8_t> rest = bytes.subspan(kHeaderBytes);
  for (std::vector<std::uint8_t>& plane : planes) {
    std::uint32_t length = 0;
    if (rest.size() < sizeof length) return damaged();
    std::memcpy(&length, rest.data(), sizeof length);
    rest = rest.subspan(sizeof length);
    if (length > rest.size()) return damaged();
    Result<std::vector<std::uint8_t>> plain = detail::decompress(rest.first(length), count);
    if (!plain) return tl::unexpected(plain.error());
    if (plain->size() != count) return damaged();
    plane = std::move(*plain);
    rest = rest.subspan(length);
  }
  if (!rest.empty()) return damaged();
  return planes;
}

}  // namespace overfly::tiling
