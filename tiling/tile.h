#pragma once
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "capture/geo/tile_lattice.h"

namespace overfly::tiling {

// Where a texel's height and colour came from: bits, 0 for a texel without data.
enum TexelKind : std::uint8_t {
  kNoData = 0,
  kMeasured = 1,     // matched in two or more frames
  kFilled = 2,       // interpolated from measured neighbours
  kProvisional = 4,  // a fallback (one view, a plane, a prior): the first better result replaces it
};

// One cell of the map at one zoom, decoded: all layers in CPU memory, `size` x `size` texels, row 0 north,
// column 0 west; texel (column i, row j) is sampled at its centre, (i + 0.5, j + 0.5) / size of the cell.
// A layer that was not made or not asked for is an empty vector; every other one has size * size elements
// (colour four times that). Value type; share it between threads as shared_ptr<const Tile>.
struct Tile {
  static constexpr std::uint16_t kNoSource = 65535;

  geo::TileKey key;
  int size = 0;
  std::vector<std::uint8_t> color;       // RGBA8, sRGB; alpha 0: no data (and then r = g = b = 0)
  std::vector<float> elevation;          // metres in the map's vertical datum; NaN: no data
  std::vector<std::uint8_t> confidence;  // 0 (none) .. 255 (certain)
  std::vector<std::uint8_t> views;       // frames that agreed on the texel
  std::vector<std::uint8_t> kind;        // TexelKind bits
  std::vector<std::uint16_t> source;     // frame that gave the colour, as an index into frame_set; kNoSource
  std::vector<std::uint8_t> gsd;         // of that frame at the texel, coded: gsdFromCode; 0: unknown
  std::vector<std::uint8_t> angle;       // between its line of sight there and the vertical: angleFromCode
  std::vector<float> elevation_max;      // see elevationMax(): set for parents, empty where it is derived
  std::vector<std::uint64_t> frame_set;  // ids of all frames that a level-0 tile is a function of, ascending;
                                         // empty for parents

  [[nodiscard]] std::size_t texels() const {
    return static_cast<std::size_t>(size) * static_cast<std::size_t>(size);
  }
  // All layers but elevation_max present, colour transparent, elevation NaN, everything else "none".
  [[nodiscard]] static Tile blank(const geo::TileKey& key, int size);
  // True when neither a visible colour nor a height is in it: such a tile is not stored.
  [[nodiscard]] bool empty() const;

  // Layer by layer, bit for bit: NaN equals NaN of the same bits.
  friend bool operator==(const Tile& a, const Tile& b);
};

// Ground sampling distance as one byte: code c in 1..255 is 1 mm * 2^((c - 1) / 16), so 1 mm .. 60 m in
// steps of 4.4 %; out-of-range values are clamped; 0 stands for unknown (NaN, or not positive).
[[nodiscard]] std::uint8_t gsdCode(double gsd_m);
[[nodiscard]] double gsdFromCode(std::uint8_t code);

// Angle of a line of sight from the vertical as one byte: 1 + half degrees, 0..90 degrees; 0: unknown.
[[nodiscard]] std::uint8_t angleCode(double angle);     // radians; negative or NaN: unknown
[[nodiscard]] double angleFromCode(std::uint8_t code);  // radians, NaN for unknown

// The ray-caster's bound: for each texel the largest height that the bilinear surface through the texel
// centres takes over the texel's square, i.e. the maximum of the 3x3 neighbourhood of texels (only what is
// inside the tile; a neighbour tile's border is the reader's to add). A parent's own elevation_max is used
// where it is set, and lies above all finer tiles' too. NaN where none of the nine has data. size x size
// values, each a height of the tile: whoever rounds them rounds up.
[[nodiscard]] std::vector<float> elevationMax(const Tile& tile);
// Largest height of the whole tile; nullopt without data.
[[nodiscard]] std::optional<float> highest(const Tile& tile);
[[nodiscard]] std::optional<float> lowest(const Tile& tile);

}  // namespace overfly::tiling
