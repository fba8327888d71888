#include "tiling/store/layer.h"

namespace overfly::tiling {

std::string_view name(Layer layer) {
  switch (layer) {
    case Layer::Color:
      return "color";
    case Layer::Elevation:
      return "elevation";
    case Layer::ElevationMax:
      return "elevation_max";
    case Layer::Quality:
      return "quality";
    case Layer::State:
      return "state";
    case Layer::Thermal:
      return "thermal";
    case Layer::NearInfrared:
      return "near_infrared";
  }
  return "unknown";
}

std::optional<Layer> layerNamed(std::string_view text) {
  for (const Layer layer : kLayers)
    if (name(layer) == text) return layer;
  return std::nullopt;
}

std::string_view mediaType(Codec codec) {
  switch (codec) {
    case Codec::Jpeg:
      return "image/jpeg";
    case Codec::Webp:
      return "image/webp";
    default:
      return "application/octet-stream";
  }
}

}  // namespace overfly::tiling
