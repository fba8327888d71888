#include "tiling/adjust/control_file.h"

#include <fmt/format.h>

#include <GeographicLib/UTMUPS.hpp>
#include <algorithm>
#include <charconv>
#include <fstream>
#include <map>
#include <optional>
#include <regex>
#include <sstream>

namespace overfly::tiling::adjust {
namespace {

std::optional<double> number(const std::string& text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

// How x and y of a gcp_list.txt are to be read: zone 0 is longitude and latitude in degrees.
struct Projection {
  int zone = 0;
  bool north = true;
};

std::optional<Projection> projectionOf(const std::string& line) {
  std::smatch m;
  if (line.find("EPSG:4326") != std::string::npos || line.find("+proj=longlat") != std::string::npos)
    return Projection{};
  if (std::regex_search(line, m, std::regex("EPSG:32([67])(\\d\\d)")))
    return Projection{std::stoi(m[2]), m[1] == "6"};
  if (std::regex_search(line, m, std::regex("UTM\\s+(\\d{1,2})\\s*([NS])", std::regex::icase)))
    return Projection{std::stoi(m[1]), m[2] == "N" || m[2] == "n"};
  if (line.find("+proj=utm") != std::string::npos &&
      std::regex_search(line, m, std::regex("\\+zone=(\\d{1,2})")))
    return Projection{std::stoi(m[1]), line.find("+south") == std::string::npos};
  return std::nullopt;
}

std::vector<std::string> cells(const std::string& line, bool commas) {
  std::vector<std::string> out;
  std::string cell;
  std::istringstream stream(line);
  if (!commas) {
    while (stream >> cell) out.push_back(cell);
    return out;
  }
  while (std::getline(stream, cell, ',')) {
    const auto first = cell.find_first_not_of(" \t"), last = cell.find_last_not_of(" \t");
    out.push_back(first == std::string::npos ? "" : cell.substr(first, last - first + 1));
  }
  return out;
}

class Collector {
 public:
  ControlEntry& entry(const std::string& key) {
    const auto [it, fresh] = index_.try_emplace(key, entries_.size());
    if (fresh) entries_.emplace_back().name = key;
    return entries_[it->second];
  }
  std::vector<ControlEntry> take() { return std::move(entries_); }

 private:
  std::map<std::string, std::size_t> index_;
  std::vector<ControlEntry> entries_;
};

tl::unexpected<Error> badLine(const std::filesystem::path& file, int line, const std::string& why) {
  return fail(ErrorCode::BadInput, fmt::format("{}, line {}: {}", file.string(), line, why));
}

}  // namespace

Result<std::vector<ControlEntry>> readControlFile(const std::filesystem::path& file) {
  std::ifstream stream(file);
  if (!stream)
    return fail(ErrorCode::NotFound, fmt::format("cannot read the control point file {}", file.string()));
  std::string line;
  int row = 0;
  const auto next = [&] {
    while (std::getline(stream, line)) {
      ++row;
      if (!line.empty() && line.back() == '\r') line.pop_back();
      if (!line.empty() && line[0] != '#') return true;
    }
    return false;
  };
  if (!next()) return fail(ErrorCode::BadInput, fmt::format("{} is empty", file.string()));
  const auto header = cells(line, true);
  const auto column = [&](const char* name) {
    return static_cast<std::size_t>(std::find(header.begin(), header.end(), name) - header.begin());
  };
  Collector points;
  if (column("lat") < header.size()) {
    for (const char* needed : {"name", "lon", "height", "image", "px", "py"})
      if (column(needed) == header.size()) return badLine(file, row, fmt::format("no column \"{}\"", needed));
    while (next()) {
      auto row_cells = cells(line, true);
      row_cells.resize(header.size());
      const auto value = [&](const char* name) {
        return column(name) < header.size() ? number(row_cells[column(name)]) : std::nullopt;
      };
      const auto lat = value("lat"), lon = value("lon"), height = value("height"), px = value("px"),
                 py = value("py");
      if (!lat || !lon || !height || !px || !py || std::abs(*lat) > 90 || std::abs(*lon) > 360)
        return badLine(file, row, "lat, lon, height, px and py must be numbers");
      ControlEntry& entry = points.entry(row_cells[column("name")]);
      entry.place = {geo::radians(*lat), geo::radians(*lon), *height};
      if (const auto sigma = value("sigma"); sigma && *sigma > 0) entry.sigma_m.setConstant(*sigma);
      if (const auto up = value("sigma_up"); up && *up > 0) entry.sigma_m.z() = *up;
      entry.check = value("check").value_or(0) != 0;
      entry.marks.push_back({row_cells[column("image")], {*px, *py}});
    }
    return points.take();
  }
  const auto projection = projectionOf(line);
  if (!projection)
    return fail(
        ErrorCode::Unsupported,
        fmt::format("{}: the projection \"{}\" is neither longitude/latitude nor UTM on WGS84; convert the "
                    "points to EPSG:4326",
                    file.string(), line));
  while (next()) {
    const auto c = cells(line, false);
    if (c.size() < 6) return badLine(file, row, "expected: x y z pixel_x pixel_y image [name]");
    const auto x = number(c[0]), y = number(c[1]), z = number(c[2]), px = number(c[3]), py = number(c[4]);
    if (!x || !y || !z || !px || !py) return badLine(file, row, "the first five values must be numbers");
    double lat = *y, lon = *x;
    if (projection->zone > 0) {
      try {
        GeographicLib::UTMUPS::Reverse(projection->zone, projection->north, *x, *y, lat, lon);
      } catch (const std::exception& e) {
        return badLine(file, row, e.what());
      }
    }
    if (std::abs(lat) > 90) return badLine(file, row, "the second value is no latitude");
    ControlEntry& entry = points.entry(c.size() > 6 ? c[6] : c[0] + " " + c[1] + " " + c[2]);
    entry.place = {geo::radians(lat), geo::radians(lon), *z};
    entry.marks.push_back({c[5], {*px, *py}});
  }
  return points.take();
}

}  // namespace overfly::tiling::adjust
