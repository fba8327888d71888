#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "config/error.h"
#include "tiling/store/map_store.h"

// The bytes of /bundle: whole stored tiles, one record after another (docs/link.md, "Bundles").
// Little-endian.
//
//   0  "OFT1"          8  i64 x               32 u64 since      56 f32 gsd_m
//   4  u8 zoom         16 i64 y               40 u64 until      60 u32 CRC-32 of the record with this field 0
//   5  u8 flags        24 u64 revision        48 u32 length of what follows the head
//   6  u16 layers                             52 u32 0
// then for each layer: u8 layer, u8 codec, u16 0, u32 bytes, f32 min, f32 max, u32 valid, u32 0,
// u64 revision, and the bytes as the store holds them.
namespace overfly::link {

inline constexpr std::size_t kRecordHead = 64;
inline constexpr std::size_t kLayerHead = 32;
inline constexpr std::size_t kLargestRecord = 64u << 20;

struct TileRecord {
  geo::TileKey key;
  std::uint64_t revision = 0;          // of the tile, at the drone
  std::uint64_t since = 0, until = 0;  // of the list that it came from; 0 when asked for by name
  float gsd_m = 0;
  bool provisional = false;
  std::vector<tiling::StoredLayer> layers;  // Codec::Erased: the layer is gone
};

[[nodiscard]] std::string encodeRecord(const TileRecord& record);

// How long the record at the head of `bytes` is; nullopt: not enough bytes yet to tell. BadInput: not a
// record.
[[nodiscard]] Result<std::optional<std::size_t>> recordLength(std::string_view bytes);
// Key, revision, since and until of the record that begins there; nullopt: no head, or not all of it yet.
[[nodiscard]] std::optional<TileRecord> recordHead(std::string_view bytes);
// Of exactly one whole record. BadInput: torn or damaged.
[[nodiscard]] Result<TileRecord> decodeRecord(std::string_view bytes);

// A layer of a tile asked for by name (/bundle?tiles=), as text LAYER/Z/X/Y[+BYTES@REVISION]; x is unwrapped.
struct WantedTile {
  tiling::Layer layer = tiling::Layer::Color;
  geo::TileKey key;
  std::uint64_t bytes = 0;     // of the record that the client has already ...
  std::uint64_t revision = 0;  // ... if it is still this revision
};
[[nodiscard]] std::string text(const WantedTile& wanted);

}  // namespace overfly::link
