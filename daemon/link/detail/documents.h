#pragma once
#include <optional>
#include <string>
#include <vector>

#include "daemon/link/detail/map_view.h"

// The documents that tell other programs where the tiles are. Pure functions.
namespace overfly::link {

struct LayerInfo {
  std::string name;       // as in the tiles' URLs
  std::string title;      // for people
  std::string extension;  // the format that most readers know
  std::string media_type;
  std::optional<Extent> extent;
};

struct DocumentContext {
  std::string base;  // "http://host:port/prefix", no slash at the end
  std::string map_name;
  std::uint64_t revision = 0;
  std::string datum;
  std::optional<std::pair<float, float>> heights;
};

// TileJSON 3.0.0 with "revision" and, for elevation, "encoding" and "height_range" beside the standard's
// members.
[[nodiscard]] std::string tileJson(const LayerInfo& layer, const DocumentContext& context);
// OGC WMTS 1.0.0 capabilities: RESTful templates and KVP.
[[nodiscard]] std::string wmtsCapabilities(const std::vector<LayerInfo>& layers,
                                           const DocumentContext& context);

// "ellipsoid", "geoid:egm96", "home" or "unknown".
[[nodiscard]] std::string datumText(const tiling::MapMeta& meta);

[[nodiscard]] std::string escapeXml(std::string_view text);
// Scheme and host as a client may use them; `fallback` for a Host header with anything but a name or address.
[[nodiscard]] std::string safeHost(std::string_view host_header, const std::string& fallback);

}  // namespace overfly::link
