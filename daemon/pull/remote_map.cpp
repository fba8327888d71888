#include "daemon/pull/remote_map.h"

#include <nlohmann/json.hpp>

namespace overfly::pull {
namespace {

constexpr int kMostZoom = 63;

std::optional<std::int64_t> integer(const nlohmann::json& node, const char* name) {
  const auto found = node.find(name);
  if (found == node.end() || !found->is_number_integer()) return std::nullopt;
  return found->get<std::int64_t>();
}

std::string text(const nlohmann::json& node, const char* name) {
  const auto found = node.find(name);
  return found != node.end() && found->is_string() ? found->get<std::string>() : std::string();
}

}  // namespace

Result<RemoteMap> parseRemoteMap(const std::string& document) {
  const auto node = nlohmann::json::parse(document, nullptr, false);
  const auto refuse = [] {
    return fail(ErrorCode::Unsupported,
                "what answers there is no link of overfly that can be mirrored; is its version older than "
                "this one's?");
  };
  if (!node.is_object()) return refuse();
  RemoteMap out;
  out.id = text(node, "map");
  out.mission = text(node, "mission");
  out.meta.name = text(node, "name");
  out.meta.lattice = text(node, "lattice");
  const auto size = integer(node, "tile_size"), zoom = integer(node, "base_zoom"),
             revision = integer(node, "revision");
  const auto step = node.find("elevation_step_m");
  if (out.id.empty() || !size || !zoom || !revision || *revision < 0 || step == node.end() ||
      !step->is_number() || !geo::TileLattice::parse(out.meta.lattice))
    return refuse();
  out.revision = static_cast<std::uint64_t>(*revision);
  out.meta.tile_size = static_cast<int>(*size);
  out.meta.base_zoom = static_cast<int>(*zoom);
  out.meta.elevation_step_m = step->get<double>();
  const auto datum = text(node, "vertical_datum");
  constexpr std::string_view kGeoid = "geoid:";
  if (datum == "ellipsoid") out.meta.datum = capture::VerticalDatum::Ellipsoid;
  if (datum == "home") out.meta.datum = capture::VerticalDatum::Home;
  if (datum.starts_with(kGeoid)) {
    out.meta.datum = capture::VerticalDatum::Geoid;
    out.meta.geoid = datum.substr(kGeoid.size());
  }
  return out;
}

std::optional<ChangeLine> parseChange(const std::string& line) {
  const auto node = nlohmann::json::parse(line, nullptr, false);
  if (!node.is_object()) return std::nullopt;
  const auto layer = tiling::layerNamed(text(node, "layer"));
  const auto zoom = integer(node, "z"), x = integer(node, "x"), y = integer(node, "y"),
             unwrapped = integer(node, "ux"), revision = integer(node, "rev"), bytes = integer(node, "bytes");
  if (!layer || !zoom || *zoom < 0 || *zoom > kMostZoom || !x || !y || !revision || *revision <= 0 || !bytes)
    return std::nullopt;
  ChangeLine out;
  out.listed = {{{static_cast<int>(*zoom), unwrapped.value_or(*x), *y}, *layer},
                static_cast<std::uint64_t>(*revision),
                static_cast<std::uint32_t>(*bytes)};
  out.unwrapped = unwrapped.has_value();
  const auto erased = node.find("erased");
  out.erased = erased != node.end() && *erased == true;
  return out;
}

std::optional<Listed> parseEventTile(const nlohmann::json& tile) {
  if (!tile.is_array() || tile.size() != 5 || !tile[0].is_string()) return std::nullopt;
  for (std::size_t i = 1; i < 5; ++i)
    if (!tile[i].is_number_integer()) return std::nullopt;
  const auto layer = tiling::layerNamed(tile[0].get<std::string>());
  const auto zoom = tile[1].get<std::int64_t>(), revision = tile[4].get<std::int64_t>();
  if (!layer || zoom < 0 || zoom > kMostZoom || revision <= 0) return std::nullopt;
  return Listed{{{static_cast<int>(zoom), tile[2].get<std::int64_t>(), tile[3].get<std::int64_t>()}, *layer},
                static_cast<std::uint64_t>(revision),
                0};
}

}  // namespace overfly::pull
