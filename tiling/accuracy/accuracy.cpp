#include "tiling/accuracy/accuracy.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>

namespace overfly::tiling {

Result<std::vector<ReferencePoint>> readReferencePoints(const std::filesystem::path& file,
                                                        const geo::Geodetic& origin) {
  std::ifstream in(file);
  if (!in)
    return fail(ErrorCode::NotFound, fmt::format("{} does not exist or cannot be read", file.string()));
  const geo::LocalFrame local(origin);
  std::vector<ReferencePoint> points;
  std::string line;
  std::getline(in, line);
  std::map<std::string, std::size_t> column;
  std::stringstream header(line);
  for (std::string name; std::getline(header, name, ',');) column.emplace(name, column.size());
  for (const char* needed : {"x", "y", "z"})
    if (!column.contains(needed))
      return fail(ErrorCode::BadInput, fmt::format("{}:1: no column {}", file.string(), needed));
  for (int number = 2; std::getline(in, line); ++number) {
    std::vector<double> values;
    std::stringstream cells(line);
    try {
      for (std::string cell; std::getline(cells, cell, ',');) values.push_back(std::stod(cell));
    } catch (const std::exception&) {
      return fail(ErrorCode::BadInput, fmt::format("{}:{}: not a number", file.string(), number));
    }
    if (values.size() < column.size())
      return fail(ErrorCode::BadInput, fmt::format("{}:{}: {} of {} columns", file.string(), number,
                                                   values.size(), column.size()));
    ReferencePoint point;
    point.place = geo::geodeticFromEcef(
        local.ecefFromEnu({values[column["x"]], values[column["y"]], values[column["z"]]}));
    if (column.contains("track_length")) point.track = static_cast<int>(values[column["track_length"]]);
    points.push_back(point);
  }
  return points;
}

ErrorStatistics statisticsOf(std::vector<double> errors, std::size_t points) {
  ErrorStatistics s;
  s.points = points;
  s.measured = errors.size();
  if (errors.empty()) return s;
  const auto n = static_cast<double>(errors.size());
  s.complete = n / static_cast<double>(points);
  const auto quantile = [](std::vector<double>& values, double q) {
    const auto at =
        values.begin() + static_cast<std::ptrdiff_t>(std::min(static_cast<double>(values.size() - 1),
                                                              q * static_cast<double>(values.size())));
    std::nth_element(values.begin(), at, values.end());
    return *at;
  };
  s.median = quantile(errors, 0.5);
  std::vector<double> deviation, absolute;
  double squares = 0;
  for (const double e : errors) {
    deviation.push_back(std::abs(e - s.median));
    absolute.push_back(std::abs(e));
    squares += e * e;
    s.beyond_5 += std::abs(e) > 5 ? 1 / n : 0;
    s.beyond_10 += std::abs(e) > 10 ? 1 / n : 0;
  }
  s.nmad = 1.4826 * quantile(deviation, 0.5);
  s.rmse = std::sqrt(squares / n);
  s.p90 = quantile(absolute, 0.9);
  s.p99 = quantile(absolute, 0.99);
  return s;
}

std::optional<double> heightAt(const std::map<geo::TileKey, Tile>& tiles, const geo::TileLattice& lattice,
                               int zoom, double anchor_px, const geo::Geodetic& place, bool filled) {
  const auto plane = lattice.planeFromGeodetic(place.lat, place.lon, anchor_px);
  if (!plane || tiles.empty()) return std::nullopt;
  const int size = tiles.begin()->second.size;
  const Eigen::Vector2d texel = *plane * std::ldexp(1.0, zoom) * size;  // global texel coordinates
  const double gx = texel.x() - 0.5, gy = texel.y() - 0.5;
  const auto ix = static_cast<std::int64_t>(std::floor(gx)), iy = static_cast<std::int64_t>(std::floor(gy));
  const double fx = gx - static_cast<double>(ix), fy = gy - static_cast<double>(iy);
  double sum = 0;
  for (int k = 0; k < 4; ++k) {
    const std::int64_t x = ix + (k & 1), y = iy + (k >> 1);
    const auto floorDiv = [size](std::int64_t v) { return v >= 0 ? v / size : -((-v + size - 1) / size); };
    const geo::TileKey key{zoom, floorDiv(x), floorDiv(y)};
    const auto tile = tiles.find(key);
    if (tile == tiles.end()) return std::nullopt;
    const auto at = static_cast<std::size_t>(y - key.y * size) * static_cast<std::size_t>(size) +
                    static_cast<std::size_t>(x - key.x * size);
    if (std::isnan(tile->second.elevation[at]) || (!filled && (tile->second.kind[at] & kMeasured) == 0))
      return std::nullopt;
    sum += ((k & 1) != 0 ? fx : 1 - fx) * ((k >> 1) != 0 ? fy : 1 - fy) *
           static_cast<double>(tile->second.elevation[at]);
  }
  return sum;
}

Comparison compare(const std::map<geo::TileKey, Tile>& tiles, const geo::TileLattice& lattice, int zoom,
                   double anchor_px, std::span<const ReferencePoint> points, double gsd_m, int strong_track) {
  Comparison result;
  double mean_track = 0;
  for (const ReferencePoint& point : points) mean_track += point.track / static_cast<double>(points.size());
  result.strong_track = strong_track > 0 ? strong_track : static_cast<int>(std::lround(mean_track));
  std::vector<double> strong, all;
  std::size_t strong_points = 0;
  for (const ReferencePoint& point : points) {
    const bool is_strong = point.track >= result.strong_track;
    strong_points += is_strong ? 1 : 0;
    const auto height = heightAt(tiles, lattice, zoom, anchor_px, point.place);
    if (!height) continue;
    const double error = (*height - point.place.height_m) / gsd_m;
    all.push_back(error);
    if (is_strong) strong.push_back(error);
  }
  result.strong = statisticsOf(std::move(strong), strong_points);
  result.all = statisticsOf(std::move(all), points.size());
  return result;
}

}  // namespace overfly::tiling
