#include "daemon/governor/operating_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "governor_shaders.h"

namespace overfly::daemon {

tiling::SweepOptions OperatingPoint::applied(tiling::SweepOptions base) const {
  base.max_views = std::min(images, base.max_views);
  base.window_radius = std::min(window_radius, base.window_radius);
  base.levels = std::max(levels, base.levels);
  base.finest_level = std::max(finest_level, base.finest_level);
  base.widenings = std::min(widenings, base.widenings);
  base.two_surfaces = two_surfaces && base.two_surfaces;
  return base;
}

Result<OperatingTable> OperatingTable::make(std::vector<OperatingPoint> points) {
  for (const OperatingPoint& point : points)
    if (!std::isfinite(point.error()) || !(point.relative_time > 0) || !std::isfinite(point.relative_time))
      return fail(
          ErrorCode::BadInput,
          fmt::format("operating point '{}': time and error must be numbers, time above 0", point.name));
  std::sort(points.begin(), points.end(), [](const OperatingPoint& a, const OperatingPoint& b) {
    return std::pair(a.relative_time, a.error()) < std::pair(b.relative_time, b.error());
  });
  OperatingTable table;
  const auto as_set =
      std::find_if(points.begin(), points.end(), [](const OperatingPoint& point) { return point.as_set; });
  std::optional<OperatingPoint> last;
  if (as_set != points.end()) {
    last = *as_set;
    points.erase(as_set, points.end());  // with all that is as slow or slower
  }
  for (OperatingPoint& point : points)
    if (table.points_.empty() || (point.error() < table.points_.back().error() &&
                                  point.relative_time > table.points_.back().relative_time))
      table.points_.push_back(std::move(point));
  if (last) table.points_.push_back(std::move(*last));
  if (table.points_.empty()) return fail(ErrorCode::BadInput, "the table of operating points is empty");
  return table;
}

Result<OperatingTable> OperatingTable::parse(std::string_view json) {
  const nlohmann::json root = nlohmann::json::parse(json, nullptr, false);
  if (!root.is_object() || !root.contains("points") || !root["points"].is_array())
    return fail(ErrorCode::BadInput, "a table of operating points is {\"points\": [...]}");
  std::vector<OperatingPoint> points;
  try {
    for (const nlohmann::json& entry : root["points"])
      points.push_back({.name = entry.at("name"),
                        .images = entry.at("images"),
                        .window_radius = entry.at("window_radius"),
                        .levels = entry.at("levels"),
                        .finest_level = entry.at("finest_level"),
                        .widenings = entry.at("widenings"),
                        .two_surfaces = entry.at("two_surfaces"),
                        .relative_time = entry.at("relative_time"),
                        .nmad_gsd = entry.at("nmad_gsd"),
                        .complete = entry.at("complete"),
                        .as_set = entry.value("as_set", false)});
  } catch (const nlohmann::json::exception& error) {
    return fail(ErrorCode::BadInput, fmt::format("table of operating points: {}", error.what()));
  }
  return make(std::move(points));
}

const OperatingTable& OperatingTable::shipped() {
  static const OperatingTable table = parse(shaders::governor::operating_points_json).value();
  return table;
}

std::string OperatingTable::json() const {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const OperatingPoint& p : points_)
    list.push_back({{"name", p.name},
                    {"images", p.images},
                    {"window_radius", p.window_radius},
                    {"levels", p.levels},
                    {"finest_level", p.finest_level},
                    {"widenings", p.widenings},
                    {"two_surfaces", p.two_surfaces},
                    {"relative_time", p.relative_time},
                    {"nmad_gsd", p.nmad_gsd},
                    {"complete", p.complete},
                    {"as_set", p.as_set}});
  return nlohmann::ordered_json{{"points", list}}.dump(2) + "\n";
}

}  // namespace overfly::daemon
