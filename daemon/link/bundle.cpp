#include "daemon/link/bundle.h"

#include <zlib.h>

#include <bit>
#include <cstring>

namespace overfly::link {
namespace {

static_assert(std::endian::native == std::endian::little);
constexpr std::string_view kMagic = "OFT1";
constexpr std::size_t kLengthAt = 48, kCrcAt = 60;
enum Flag : std::uint8_t { kProvisional = 1 };

template <typename T>
void append(std::string& to, T value) {
  to.append(reinterpret_cast<const char*>(&value), sizeof value);
}

// Callers have checked that the bytes are there.
template <typename T>
T take(std::string_view bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

std::uint32_t checksum(std::string_view record) {
  const auto* data = reinterpret_cast<const Bytef*>(record.data());
  constexpr std::uint32_t kZero = 0;
  auto crc = crc32(0, data, kCrcAt);
  crc = crc32(crc, reinterpret_cast<const Bytef*>(&kZero), sizeof kZero);
  crc = crc32_z(crc, data + kRecordHead, record.size() - kRecordHead);
  return static_cast<std::uint32_t>(crc);
}

}  // namespace

std::string encodeRecord(const TileRecord& record) {
  std::string out(kMagic);
  append(out, static_cast<std::uint8_t>(record.key.zoom));
  append(out, static_cast<std::uint8_t>(record.provisional ? kProvisional : 0));
  append(out, static_cast<std::uint16_t>(record.layers.size()));
  append(out, record.key.x);
  append(out, record.key.y);
  append(out, record.revision);
  append(out, record.since);
  append(out, record.until);
  append(out, std::uint32_t{0});  // the length, below
  append(out, std::uint32_t{0});
  append(out, record.gsd_m);
  append(out, std::uint32_t{0});  // the checksum, below
  for (const auto& layer : record.layers) {
    const auto& e = layer.encoded;
    append(out, static_cast<std::uint8_t>(e.layer));
    append(out, static_cast<std::uint8_t>(e.codec));
    append(out, std::uint16_t{0});
    append(out, static_cast<std::uint32_t>(e.bytes.size()));
    append(out, e.statistics.min);
    append(out, e.statistics.max);
    append(out, e.statistics.valid);
    append(out, std::uint32_t{0});
    append(out, layer.revision);
    out.append(reinterpret_cast<const char*>(e.bytes.data()), e.bytes.size());
  }
  const auto length = static_cast<std::uint32_t>(out.size() - kRecordHead);
  std::memcpy(out.data() + kLengthAt, &length, sizeof length);
  const auto crc = checksum(out);
  std::memcpy(out.data() + kCrcAt, &crc, sizeof crc);
  return out;
}

Result<std::optional<std::size_t>> recordLength(std::string_view bytes) {
  const auto known = std::min(bytes.size(), kMagic.size());
  if (bytes.substr(0, known) != kMagic.substr(0, known))
    return fail(ErrorCode::BadInput, "the bundle does not hold a tile record where one should begin");
  if (bytes.size() < kRecordHead) return std::nullopt;
  const auto length = kRecordHead + take<std::uint32_t>(bytes, kLengthAt);
  if (length > kLargestRecord)
    return fail(ErrorCode::BadInput, "a tile record in the bundle is absurdly long");
  return length;
}

std::optional<TileRecord> recordHead(std::string_view bytes) {
  if (bytes.size() < kRecordHead || !bytes.starts_with(kMagic)) return std::nullopt;
  TileRecord out;
  out.key = {take<std::uint8_t>(bytes, 4), take<std::int64_t>(bytes, 8), take<std::int64_t>(bytes, 16)};
  out.provisional = (take<std::uint8_t>(bytes, 5) & kProvisional) != 0;
  out.revision = take<std::uint64_t>(bytes, 24);
  out.since = take<std::uint64_t>(bytes, 32);
  out.until = take<std::uint64_t>(bytes, 40);
  out.gsd_m = take<float>(bytes, 56);
  return out;
}

Result<TileRecord> decodeRecord(std::string_view bytes) {
  const auto length = recordLength(bytes);
  if (!length) return tl::unexpected(length.error());
  const auto damaged = [] { return fail(ErrorCode::BadInput, "a tile record in the bundle is damaged"); };
  if (*length != bytes.size() || take<std::uint32_t>(bytes, kCrcAt) != checksum(bytes)) return damaged();
  TileRecord out = *recordHead(bytes);
  const int layers = take<std::uint16_t>(bytes, 6);
  std::size_t at = kRecordHead;
  for (int i = 0; i < layers; ++i) {
    if (bytes.size() - at < kLayerHead) return damaged();
    tiling::StoredLayer layer;
    layer.encoded.layer = static_cast<tiling::Layer>(take<std::uint8_t>(bytes, at));
    layer.encoded.codec = static_cast<tiling::Codec>(take<std::uint8_t>(bytes, at + 1));
    const auto size = take<std::uint32_t>(bytes, at + 4);
    layer.encoded.statistics = {take<float>(bytes, at + 8), take<float>(bytes, at + 12),
                                take<std::uint32_t>(bytes, at + 16)};
    layer.revision = take<std::uint64_t>(bytes, at + 24);
    at += kLayerHead;
    if (bytes.size() - at < size) return damaged();
    const auto* data = reinterpret_cast<const std::uint8_t*>(bytes.data()) + at;
    layer.encoded.bytes.assign(data, data + size);
    at += size;
    out.layers.push_back(std::move(layer));
  }
  if (at != bytes.size()) return damaged();
  return out;
}

std::string text(const WantedTile& wanted) {
  auto out = std::string(tiling::name(wanted.layer)) + "/" + std::to_string(wanted.key.zoom) + "/" +
             std::to_string(wanted.key.x) + "/" + std::to_string(wanted.key.y);
  if (wanted.bytes > 0) out += "+" + std::to_string(wanted.bytes) + "@" + std::to_string(wanted.revision);
  return out;
}

}  // namespace overfly::link
