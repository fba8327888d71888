#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "daemon/link/detail/decode.h"
#include "daemon/link/detail/image_codec.h"
#include "daemon/link/detail/resample.h"
#include "daemon/link/detail/routes.h"

namespace overfly::link {
namespace {

constexpr double kMercatorHalf_m = 20037508.342789244;  // of EPSG:3857
constexpr int kColorQuality = 82;

// FNV-1a, 64 bits.
class Hash {
 public:
  void add(std::string_view bytes) {
    for (const char c : bytes) state_ = (state_ ^ static_cast<unsigned char>(c)) * 0x100000001b3ull;
  }
  template <typename T>
  requires std::is_integral_v<T>
  void add(T value) { add(std::string_view(reinterpret_cast<const char*>(&value), sizeof value)); }
  [[nodiscard]] std::uint64_t value() const { return state_; }

 private:
  std::uint64_t state_ = 0xcbf29ce484222325ull;
};

// Strong: the map, the rendition, and every stored tile with its revision decide the bytes.
std::string etagOf(const tiling::MapMeta& meta, const std::string& rendition, const LinkKey& key,
                   const Composition& composition) {
  Hash hash;
  hash.add(meta.id);
  hash.add(rendition);
  hash.add(key.zoom);
  hash.add(key.x);
  hash.add(key.y);
  for (const auto& piece : composition.pieces) {
    hash.add(piece.key.zoom);
    hash.add(piece.key.x);
    hash.add(piece.key.y);
    hash.add(piece.revision);
  }
  return fmt::format("\"{}-{:016x}\"", composition.revision(), hash.value());
}

std::string mediaTypeOf(const std::string& extension) {
  if (extension == "webp") return "image/webp";
  if (extension == "png") return "image/png";
  if (extension == "jpg" || extension == "jpeg") return "image/jpeg";
  if (extension == "tif" || extension == "tiff") return "image/tiff; application=geotiff";
  return {};
}

std::string encode(const Rgba& image, const std::string& extension, bool lossless) {
  if (extension == "png") return encodePng(image);
  if (extension == "webp") return encodeWebp(image, lossless ? 101 : kColorQuality);
  return encodeJpeg(image, kColorQuality);
}

double texelMetres(const LinkKey& key) {
  const double side = std::ldexp(1.0, key.zoom);
  const double lat =
      std::atan(std::sinh(std::numbers::pi * (1 - 2 * (static_cast<double>(key.y) + 0.5) / side)));
  return 2 * kMercatorHalf_m / side / kLinkTile * std::cos(lat);
}

}  // namespace

Response Routes::tile(const Visit& visit, const TilePath& path) {
  const auto& [request, mission, view] = visit;
  const LinkKey key{path.zoom, path.x, path.y};
  const auto type = mediaTypeOf(path.extension);
  const bool jpeg = path.extension == "jpg" || path.extension == "jpeg";
  const bool tiff = path.extension == "tif" || path.extension == "tiff";
  const auto& layer = path.layer;
  const auto named = tiling::layerNamed(layer);
  const bool picture = named && tiling::isPicture(*named);
  const bool known = picture                ? !type.empty() && !tiff
                     : layer == "elevation" ? !type.empty() && !jpeg
                     : layer == "hillshade" || layer == "quality"
                         ? path.extension == "png" || path.extension == "webp"
                         : false;
  if (!known) return Response::text(404, "There is no such layer or format; see /tiles.json.\n");

  const auto stored_layer = named.value_or(tiling::Layer::Elevation);
  const auto composition = layer == "hillshade" ? view.neighbourhood(key) : view.compose(stored_layer, key);
  if (!composition) return failure(composition.error());
  if (mission.current)
    if (const auto looked = view.storedKey(key)) backend_->interest(*looked);

  // Heights may be asked for above a chosen level: viewers that drape a terrain have no other zero than 0.
  std::string rendition = layer + "." + path.extension;
  double minus_m = 0;
  if (layer == "elevation" && !tiff) {
    if (const auto minus = request.arg("minus")) {
      const auto number = parseNumber(*minus);
      if (!number || std::abs(*number) > 12000)
        return Response::text(400, "minus: metres, -12000 ... 12000\n");
      minus_m = *number;
      rendition += "-" + *minus;
    }
  }
  const auto etag = etagOf(view.meta(), rendition, key, *composition);
  return conditional(request, etag, [&, &view = view]() -> Response {
    Response out;
    out.headers.emplace_back("Content-Type", type);
    out.body = cache_.find(etag);
    if (out.body) return out;
    std::string bytes;
    if (picture) {
      if (view.isWhole(*composition)) {
        // the stored file as it is: no second loss, no work
        const auto stored = view.reader().read(composition->pieces[0].key, stored_layer);
        if (!stored) return failure(stored.error());
        const auto media = tiling::mediaType(stored->encoded.codec);
        const bool fits = media == type || path.extension == "webp";
        if (fits && media.starts_with("image/")) {
          out.headers[0].second = media;
          const auto& b = stored->encoded.bytes;
          out.body = std::make_shared<const std::string>(b.begin(), b.end());
          return out;
        }
      }
      const auto image = view.picture(*composition, stored_layer);
      if (!image) return failure(image.error());
      bytes = encode(*image, path.extension, false);
    } else if (layer == "quality") {
      const auto image = view.quality(*composition);
      if (!image) return failure(image.error());
      bytes = encode(*image, path.extension, true);
    } else if (layer == "hillshade") {
      const auto heights = view.borderedHeights(key);
      if (!heights) return failure(heights.error());
      bytes = encode(hillshade(*heights, texelMetres(key)), path.extension, true);
    } else {
      auto heights = view.heights(*composition);
      if (!heights) return failure(heights.error());
      if (tiff) {
        const double cell_m = 2 * kMercatorHalf_m / std::ldexp(1.0, key.zoom);
        bytes = encodeGeoTiff(*heights, -kMercatorHalf_m + static_cast<double>(key.x) * cell_m,
                              kMercatorHalf_m - static_cast<double>(key.y) * cell_m, cell_m / kLinkTile);
      } else {
        for (auto& h : heights->texels) h -= static_cast<float>(minus_m);
        const auto range = view.heightRange();
        const float ground = range ? range->first - static_cast<float>(minus_m) : 0;
        bytes = encode(terrarium(*heights, ground), path.extension, true);
      }
    }
    if (bytes.empty()) return Response::text(500, "The tile's image could not be coded.\n");
    out.body = std::make_shared<const std::string>(std::move(bytes));
    cache_.add(etag, out.body);
    return out;
  });
}

std::vector<LayerInfo> Routes::layers(const MapView& view) const {
  const auto color = view.extent(tiling::Layer::Color);
  const auto elevation = view.extent(tiling::Layer::Elevation);
  const auto quality = view.extent(tiling::Layer::Quality);
  std::vector<LayerInfo> out{{"color", "true orthophoto", "webp", "image/webp", color},
                             {"elevation", "elevation", "png", "image/png", elevation},
                             {"hillshade", "hillshade", "png", "image/png", elevation},
                             {"quality", "quality", "png", "image/png", quality},
                             {"coverage", "coverage", "png", "image/png", color ? color : elevation}};
  if (const auto thermal = view.extent(tiling::Layer::Thermal))
    out.push_back({"thermal", "thermal orthophoto", "webp", "image/webp", thermal});
  if (const auto infrared = view.extent(tiling::Layer::NearInfrared))
    out.push_back({"near_infrared", "near-infrared orthophoto", "webp", "image/webp", infrared});
  return out;
}

DocumentContext Routes::documentContext(const Visit& visit) const {
  DocumentContext out;
  out.base = baseUrl(visit.request);
  out.map_name = visit.mission.name;
  out.revision = visit.view.reader().revision().value_or(0);
  // read anew: the datum may become known after the map was made
  const auto meta = visit.view.reader().meta();
  const auto& m = meta ? *meta : visit.view.meta();
  out.datum = datumText(m);
  out.heights = visit.view.heightRange();
  return out;
}

Response Routes::layerDocument(const Visit& visit, const std::string& name) {
  for (const auto& layer : layers(visit.view)) {
    if (layer.name != name) continue;
    const auto text = tileJson(layer, documentContext(visit));
    Hash hash;
    hash.add(text);
    return conditional(visit.request, fmt::format("\"{:016x}\"", hash.value()),
                       [&] { return Response::json(text); });
  }
  return Response::text(404, "There is no such layer; see /tiles.json.\n");
}

Response Routes::layerList(const Visit& visit) {
  const auto context = documentContext(visit);
  auto list = nlohmann::json::array();
  for (const auto& layer : layers(visit.view))
    list.push_back(nlohmann::json::parse(tileJson(layer, context)));
  const auto& meta = visit.view.meta();
  return Response::json(nlohmann::json{
      {"map", meta.id},
      {"name", visit.mission.name},
      {"mission", visit.mission.id},
      {"revision", context.revision},
      {"lattice", meta.lattice},
      {"tile_size", meta.tile_size},
      {"vertical_datum", context.datum},
      {"base_zoom", meta.base_zoom},
      {"elevation_step_m", meta.elevation_step_m},
      {"layers", list}}.dump());
}

Response Routes::wmts(const Visit& visit) {
  std::map<std::string, std::string> args;  // KVP names know no case
  for (const auto& [name, value] : visit.request.query) {
    std::string upper(name);
    for (auto& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    args[upper] = value;
  }
  if (args["REQUEST"] == "GetTile") {
    const auto& format = args["FORMAT"];
    const std::string extension = format == "image/jpeg" ? "jpg" : format == "image/webp" ? "webp" : "png";
    const auto path = parseTilePath("/tiles/" + args["LAYER"] + "/" + args["TILEMATRIX"] + "/" +
                                    args["TILECOL"] + "/" + args["TILEROW"] + "." + extension);
    if (!path) return Response::text(400, "LAYER, TILEMATRIX, TILECOL and TILEROW do not name a tile.\n");
    return path->layer == "coverage" ? coverageTile(visit, *path) : tile(visit, *path);
  }
  if (!args["REQUEST"].empty() && args["REQUEST"] != "GetCapabilities")
    return Response::text(501, "WMTS: GetCapabilities and GetTile.\n");
  return Response::text(200, wmtsCapabilities(layers(visit.view), documentContext(visit)), "application/xml");
}

Response Routes::height(const Visit& visit) {
  const auto lat = parseNumber(visit.request.arg("lat").value_or(""));
  const auto lon = parseNumber(visit.request.arg("lon").value_or(""));
  if (!lat || !lon || std::abs(*lat) > 90 || std::abs(*lon) > 360)
    return Response::text(400, "/height?lat=DEGREES&lon=DEGREES\n");
  const auto height = visit.view.heightAt(geo::radians(*lat), geo::radians(*lon));
  if (!height) return failure(height.error());
  const auto meta = visit.view.reader().meta();
  nlohmann::json out{{"height_m", std::round(height->height_m * 1000) / 1000},
                     {"datum", datumText(meta ? *meta : visit.view.meta())},
                     {"texel_m", height->texel_m},
                     {"revision", height->revision}};
  if (height->gsd_m > 0) out["gsd_m"] = height->gsd_m;
  if (height->confidence >= 0) {
    out["confidence"] = height->confidence;
    out["views"] = height->views;
  }
  // A sweep's height steps are about as fine as the ground resolution allows: two texels is what neighbouring
  // planes differ by at the overlaps that are flown; low confidence widens it.
  const double resolution_m = std::max(height->gsd_m, height->texel_m);
  out["accuracy_m"] = 2 * resolution_m / std::max(0.25, height->confidence < 0 ? 0.5 : height->confidence);
  if (!height->frame_set.empty()) {
    if (const auto frame = visit.view.reader().frame(height->frame_set.back());
        frame && frame->utc_offset_ns != 0) {
      const auto now = std::chrono::duration_cast<std::chrono::nanoseconds>(
                           std::chrono::system_clock::now().time_since_epoch())
                           .count();
      out["age_s"] = 1e-9 * static_cast<double>(now - frame->time_ns - frame->utc_offset_ns);
    }
  }
  auto response = Response::json(out.dump());
  response.headers.emplace_back("Cache-Control", "no-cache");
  return response;
}

}  // namespace overfly::link
