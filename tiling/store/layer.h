#pragma once
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

namespace overfly::tiling {

// The layers of a tile. The numbers are part of the file format (docs/tile-store.md); the set is open: a
// reader passes over a layer it does not know.
enum class Layer : std::uint8_t {
  Color = 1,         // orthophoto, RGBA8; alpha 0: no data
  Elevation = 2,     // metres in the map's datum, to the map's elevation step; NaN: no data
  ElevationMax = 3,  // upper bound of the surface for the ray-caster, never below the decoded Elevation
  Quality = 4,       // confidence, views, kind and source frame of every texel
  State = 5,         // what the sweep goes on from: heights at full precision
  Thermal = 6,       // orthophotos of other cameras on the same surface, as Color is
  NearInfrared = 7,
};
inline constexpr Layer kLayers[] = {Layer::Color, Layer::Elevation, Layer::ElevationMax, Layer::Quality,
                                    Layer::State, Layer::Thermal,   Layer::NearInfrared};
// What a camera saw, draped over the surface.
[[nodiscard]] constexpr bool isPicture(Layer layer) {
  return layer == Layer::Color || layer == Layer::Thermal || layer == Layer::NearInfrared;
}

// "color", "elevation", "elevation_max", "quality", "state", "thermal", "near_infrared".
[[nodiscard]] std::string_view name(Layer layer);
[[nodiscard]] std::optional<Layer> layerNamed(std::string_view text);

// A set of layers, as a bit mask of 1 << number.
using LayerSet = std::uint32_t;
[[nodiscard]] constexpr LayerSet only(Layer layer) { return LayerSet{1} << static_cast<unsigned>(layer); }
inline constexpr LayerSet kAllLayers = ~LayerSet{0};
// What leaves the drone: everything but the sweep's own.
inline constexpr LayerSet kLinkLayers = only(Layer::Color) | only(Layer::Elevation) |
                                        only(Layer::ElevationMax) | only(Layer::Quality) |
                                        only(Layer::Thermal) | only(Layer::NearInfrared);
[[nodiscard]] constexpr bool contains(LayerSet set, Layer layer) { return (set & only(layer)) != 0; }

// How a layer's bytes are coded. Jpeg and Webp are ordinary files of their kind and can be sent as they are.
enum class Codec : std::uint8_t {
  Erased = 0,        // no bytes: the layer was there and is gone
  Jpeg = 1,          // colour of a tile without a hole
  Webp = 2,          // colour, alpha kept exactly
  Heights = 3,       // elevation quantised to a step: codec_heights.h
  ExactHeights = 4,  // float32 bit for bit: codec_heights.h
  Planes = 5,        // quality planes: codec_planes.h
};

// "image/jpeg", "image/webp", or "application/octet-stream" for the store's own codecs.
[[nodiscard]] std::string_view mediaType(Codec codec);

// Of the valid texels; min and max are 0 when there is none. Metres for heights, unused for other layers.
struct LayerStatistics {
  float min = 0;
  float max = 0;
  std::uint32_t valid = 0;  // texels with data
  friend bool operator==(const LayerStatistics&, const LayerStatistics&) = default;
};

// One layer of one tile as it is written and read back.
struct EncodedLayer {
  Layer layer = Layer::Color;
  Codec codec = Codec::Erased;
  std::vector<std::uint8_t> bytes;
  LayerStatistics statistics;
};

}  // namespace overfly::tiling
