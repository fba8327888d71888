#include "daemon/link/detail/documents.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>

namespace overfly::link {

std::string datumText(const tiling::MapMeta& meta) {
  switch (meta.datum) {
    case capture::VerticalDatum::Ellipsoid:
      return "ellipsoid";
    case capture::VerticalDatum::Geoid:
      return "geoid:" + meta.geoid;
    case capture::VerticalDatum::Home:
      return "home";
    case capture::VerticalDatum::Unknown:
      break;
  }
  return "unknown";
}

std::string escapeXml(std::string_view text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string safeHost(std::string_view host, const std::string& fallback) {
  const bool clean = !host.empty() && host.size() < 256 && std::ranges::all_of(host, [](unsigned char c) {
    return std::isalnum(c) || c == '.' || c == ':' || c == '-' || c == '[' || c == ']' || c == '_';
  });
  return clean ? std::string(host) : fallback;
}

std::string tileJson(const LayerInfo& layer, const DocumentContext& context) {
  nlohmann::json out{{"tilejson", "3.0.0"},
                     {"name", context.map_name + " " + layer.title},
                     {"scheme", "xyz"},
                     {"tiles", {context.base + "/tiles/" + layer.name + "/{z}/{x}/{y}." + layer.extension}},
                     {"tileSize", kLinkTile},
                     {"revision", context.revision},
                     {"vector_layers", nlohmann::json::array()}};
  if (const auto& e = layer.extent) {
    const double middle = e->box.west <= e->box.east ? 0.5 * (e->box.west + e->box.east) : 180.0;
    out["bounds"] = {e->box.west, e->box.south, e->box.east, e->box.north};
    out["center"] = {middle, 0.5 * (e->box.south + e->box.north), e->max_zoom - 2};
    out["minzoom"] = e->min_zoom;
    out["maxzoom"] = e->max_zoom;
  } else {
    out["minzoom"] = 0;
    out["maxzoom"] = 0;
    out["empty"] = true;
  }
  if (layer.name == "elevation") {
    out["encoding"] = "terrarium";
    out["vertical_datum"] = context.datum;
    if (context.heights) out["height_range"] = {context.heights->first, context.heights->second};
  }
  return out.dump();
}

std::string wmtsCapabilities(const std::vector<LayerInfo>& layers, const DocumentContext& context) {
  std::string out = fmt::format(
      R"(<?xml version="1.0" encoding="UTF-8"?>
<Capabilities xmlns="http://www.opengis.net/wmts/1.0" xmlns:ows="http://www.opengis.net/ows/1.1" xmlns:xlink="http://www.w3.org/1999/xlink" version="1.0.0">
<ows:ServiceIdentification><ows:Title>overfly: {name}</ows:Title><ows:ServiceType>OGC WMTS</ows:ServiceType><ows:ServiceTypeVersion>1.0.0</ows:ServiceTypeVersion></ows:ServiceIdentification>
<ows:OperationsMetadata>
<ows:Operation name="GetCapabilities"><ows:DCP><ows:HTTP><ows:Get xlink:href="{base}/wmts?"><ows:Constraint name="GetEncoding"><ows:AllowedValues><ows:Value>KVP</ows:Value></ows:AllowedValues></ows:Constraint></ows:Get></ows:HTTP></ows:DCP></ows:Operation>
<ows:Operation name="GetTile"><ows:DCP><ows:HTTP><ows:Get xlink:href="{base}/wmts?"><ows:Constraint name="GetEncoding"><ows:AllowedValues><ows:Value>KVP</ows:Value></ows:AllowedValues></ows:Constraint></ows:Get></ows:HTTP></ows:DCP></ows:Operation>
</ows:OperationsMetadata>
<Contents>
)",
      fmt::arg("name", escapeXml(context.map_name)), fmt::arg("base", escapeXml(context.base)));
  int max_zoom = 0;
  for (const auto& layer : layers) {
    if (!layer.extent) continue;
    const auto& e = *layer.extent;
    max_zoom = std::max(max_zoom, e.max_zoom);
    // boxes over the antimeridian are not for WMTS: the whole round instead
    const bool round = e.box.west > e.box.east;
    const double west = round ? -180 : e.box.west, east = round ? 180 : e.box.east;
    out += fmt::format(
        R"(<Layer><ows:Title>{title}</ows:Title><ows:WGS84BoundingBox><ows:LowerCorner>{w:.9f} {s:.9f}</ows:LowerCorner><ows:UpperCorner>{e:.9f} {n:.9f}</ows:UpperCorner></ows:WGS84BoundingBox><ows:Identifier>{name}</ows:Identifier><Style isDefault="true"><ows:Identifier>default</ows:Identifier></Style><Format>{media}</Format><TileMatrixSetLink><TileMatrixSet>WebMercatorQuad</TileMatrixSet><TileMatrixSetLimits>)",
        fmt::arg("title", escapeXml(layer.title)), fmt::arg("w", west), fmt::arg("s", e.box.south),
        fmt::arg("e", east), fmt::arg("n", e.box.north), fmt::arg("name", layer.name),
        fmt::arg("media", layer.media_type));
    for (int z = e.min_zoom; z <= e.max_zoom; ++z) {
      const double side = std::ldexp(1.0, z);
      const auto column = [&](double lon) { return std::clamp((lon + 180) / 360 * side, 0.0, side - 1e-6); };
      const auto row = [&](double lat) {
        const double phi = geo::radians(lat);
        return std::clamp((1 - std::asinh(std::tan(phi)) / 3.14159265358979323846) / 2 * side, 0.0,
                          side - 1e-6);
      };
      // bounds are whole cells at the finest zoom: a hair inward, so that a border names one side
      const double hair = 1e-6;
      out += fmt::format(
          "<TileMatrixLimits><TileMatrix>{}</TileMatrix><MinTileRow>{:.0f}</MinTileRow><MaxTileRow>{:.0f}</"
          "MaxTileRow>"
          "<MinTileCol>{:.0f}</MinTileCol><MaxTileCol>{:.0f}</MaxTileCol></TileMatrixLimits>",
          z, std::floor(row(e.box.north) + hair), std::floor(row(e.box.south) - hair),
          std::floor(column(west) + hair), std::floor(column(east) - hair));
    }
    out += fmt::format(
        R"(</TileMatrixSetLimits></TileMatrixSetLink><ResourceURL format="{media}" resourceType="tile" template="{base}/tiles/{name}/{{TileMatrix}}/{{TileCol}}/{{TileRow}}.{ext}"/></Layer>
)",
        fmt::arg("media", layer.media_type), fmt::arg("base", escapeXml(context.base)),
        fmt::arg("name", layer.name), fmt::arg("ext", layer.extension));
  }
  out +=
      "<TileMatrixSet><ows:Identifier>WebMercatorQuad</ows:Identifier>"
      "<ows:SupportedCRS>urn:ogc:def:crs:EPSG::3857</ows:SupportedCRS>"
      "<WellKnownScaleSet>urn:ogc:def:wkss:OGC:1.0:GoogleMapsCompatible</WellKnownScaleSet>\n";
  for (int z = 0; z <= max_zoom; ++z) {
    const double side = std::ldexp(1.0, z);
    out += fmt::format(
        "<TileMatrix><ows:Identifier>{}</ows:Identifier><ScaleDenominator>{:.10f}</ScaleDenominator>"
        "<TopLeftCorner>-20037508.342789244 20037508.342789244</TopLeftCorner><TileWidth>256</TileWidth>"
        "<TileHeight>256</TileHeight><MatrixWidth>{:.0f}</MatrixWidth><MatrixHeight>{:.0f}</MatrixHeight></"
        "TileMatrix>\n",
        z, 559082264.0287178 / side, side, side);
  }
  out += fmt::format(
      R"(</TileMatrixSet></Contents><ServiceMetadataURL xlink:href="{}/wmts/1.0.0/WMTSCapabilities.xml"/>
</Capabilities>
)",
      escapeXml(context.base));
  return out;
}

}  // namespace overfly::link
