#pragma once
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "capture/geo/geodetic.h"
#include "capture/image_decode.h"
#include "capture/record/flight.h"

// The test flights with their raw telemetry and reference side by side, read directly.
namespace overfly::tests {

struct RecordedFlight {
  capture::CameraModel reference_camera;
  geo::Geodetic origin;
  std::vector<capture::FlightFrame> frames;  // raw telemetry only
  struct Reference {
    Eigen::Vector3d position;  // ENU of the origin
    Eigen::Quaterniond enu_from_camera;
  };
  std::vector<Reference> reference;
  std::vector<Eigen::Vector3d> points;  // reference points, ENU

  static RecordedFlight read(const std::filesystem::path& folder) {
    RecordedFlight out;
    const auto camera = nlohmann::json::parse(std::ifstream(folder / "camera.json"));
    auto& c = out.reference_camera;
    c.kind = capture::CameraModel::Kind::RadialTangential;
    c.width = camera["width"];
    c.height = camera["height"];
    c.fx = camera["fx"];
    c.fy = camera["fy"];
    c.cx = camera["cx"].get<double>() + 0.5;
    c.cy = camera["cy"].get<double>() + 0.5;
    c.distortion = {camera["k1"], camera["k2"], camera["p1"], camera["p2"]};
    const auto& origin = camera["enu_origin"];
    out.origin = {geo::radians(origin["lat"]), geo::radians(origin["lon"]), origin["alt"]};
    std::ifstream table(folder / "flight.csv");
    std::string line, cell;
    std::getline(table, line);
    std::vector<std::string> names;
    for (std::istringstream s(line); std::getline(s, cell, ',');) names.push_back(cell);
    while (std::getline(table, line)) {
      std::map<std::string, std::string> row;
      std::istringstream s(line);
      for (std::size_t i = 0; std::getline(s, cell, ','); ++i) row[names[i]] = cell;
      const auto number = [&](const char* name) { return std::stod(row[name]); };
      const auto maybe = [&](const char* name, double scale) -> std::optional<double> {
        if (row[name].empty()) return std::nullopt;
        return std::stod(row[name]) * scale;
      };
      const double rad = geo::radians(1);
      capture::FlightFrame frame;
      frame.file = (folder / "images" / row["filename"]).string();
      frame.frame.name = row["filename"];
      frame.frame.time_ns = std::stoll(row["timestamp_ns"]);
      capture::RawTelemetry raw;
      raw.lat = maybe("raw_lat", rad);
      raw.lon = maybe("raw_lon", rad);
      raw.altitude_m = maybe("raw_alt", 1);
      raw.relative_altitude_m = maybe("raw_rel_alt", 1);
      raw.gimbal_yaw = maybe("raw_gimbal_yaw_deg", rad);
      raw.gimbal_pitch = maybe("raw_gimbal_pitch_deg", rad);
      raw.gimbal_roll = maybe("raw_gimbal_roll_deg", rad);
      frame.raw = std::make_shared<const capture::RawTelemetry>(raw);
      out.frames.push_back(std::move(frame));
      out.reference.push_back({{number("x"), number("y"), number("z")},
                               {number("qw"), number("qx"), number("qy"), number("qz")}});
    }
    std::ifstream points(folder / "reference_points.csv");
    std::getline(points, line);
    while (std::getline(points, line)) {
      Eigen::Vector3d p;
      char comma = 0;
      std::istringstream s(line);
      s >> p.x() >> comma >> p.y() >> comma >> p.z();
      out.points.push_back(p);
    }
    return out;
  }

  // The nominal lens: focal length as printed on it, everything else ideal.
  [[nodiscard]] capture::CameraModel nominal(double focal_mm, double pixel_um_at_4000) const {
    capture::CameraModel c;
    c.kind = capture::CameraModel::Kind::RadialTangential;
    c.distortion = {0, 0, 0, 0};
    c.width = reference_camera.width;
    c.height = reference_camera.height;
    c.fx = c.fy = focal_mm * 1000 / pixel_um_at_4000 * c.width / 4000;
    c.cx = 0.5 * c.width;
    c.cy = 0.5 * c.height;
    return c;
  }

  [[nodiscard]] capture::Image grey(std::size_t i) const {
    capture::Image jpeg;
    std::ifstream file(frames[i].file, std::ios::binary);
    jpeg.bytes.assign(std::istreambuf_iterator<char>(file), {});
    return capture::decodeImage(jpeg, capture::PixelFormat::Grey8).value();
  }
};

}  // namespace overfly::tests
