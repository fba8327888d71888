#pragma once
#include <memory>
#include <span>
#include <vector>

#include "config/error.h"
#include "tiling/store/codec_color.h"
#include "tiling/store/codec_heights.h"
#include "tiling/store/map_store.h"
#include "tiling/tile.h"

namespace overfly::tiling {

struct EncodeOptions {
  ColorCoding color;
  HeightCoding elevation;      // its step is the map's, MapMeta::elevation_step_m
  int bound_block = 4;         // texels along a side that share one elevation_max
  int bound_steps = 10;        // the bound's step, in elevation steps: it errs upwards by at most this
  int confidence_levels = 15;  // of the Quality layer, beside "none"; 255 keeps every bit
  bool state = false;          // also the State layer: heights bit for bit
};

// What a map with this meta wants its tiles coded like.
[[nodiscard]] EncodeOptions encodeOptions(const MapMeta& meta);

// Layers of a decoded tile, ready to be committed: Color, Elevation, ElevationMax and Quality as far as the
// tile has them (Quality needs kind). The bound is taken over what Elevation decodes to, and over
// `elevation_max` where a parent has one from its children (size * size values, NaN: no bound). gsd_m and
// provisional come from the tile's planes. Reentrant; the costly part of a commit, so do it off its thread.
// BadInput: planes of unequal size, a frame set that does not ascend.
[[nodiscard]] Result<TileWrite> encodeTile(const Tile& tile, const EncodeOptions& options,
                                           std::span<const float> elevation_max = {});

// A picture layer from RGBA8 values. BadInput: not size * size * 4 values.
[[nodiscard]] Result<EncodedLayer> encodePicture(std::span<const std::uint8_t> rgba, int size, Layer layer,
                                                 const ColorCoding& coding);

// What was stored, decoded; layers that are not among `layers` stay empty. State, where there, replaces the
// quantised elevation. A picture layer, whichever it is, becomes the tile's colour: name one of them.
[[nodiscard]] Result<Tile> decodeTile(const TileInfo& info, std::span<const StoredLayer> layers, int size);

inline constexpr LayerSet kTileLayers = only(Layer::Color) | only(Layer::Elevation) | only(Layer::Quality);

// One consistent tile. NotFound when none of `layers` is stored; Corrupt when one of them is damaged.
[[nodiscard]] Result<Tile> readTile(const MapReader& reader, const geo::TileKey& key,
                                    LayerSet layers = kTileLayers);
[[nodiscard]] Result<Tile> readTopTile(const MapReader& reader, LayerSet layers = kTileLayers);
// size * size values, never below the elevation that readTile gives nor its bilinear surface within the tile.
[[nodiscard]] Result<std::vector<float>> readElevationMax(const MapReader& reader, const geo::TileKey& key);

}  // namespace overfly::tiling
