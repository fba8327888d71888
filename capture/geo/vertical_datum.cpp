#include "capture/geo/vertical_datum.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>

#include "capture/geo/geodetic.h"

namespace overfly::geo {
namespace {

constexpr std::size_t kHeaderBytes = 40;  // four doubles and two int32, all big-endian
constexpr float kNoValue = -88.8888F;

template <typename T>
T bigEndian(const char* bytes) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), bytes, sizeof(T));
  if constexpr (std::endian::native == std::endian::little) std::reverse(raw.begin(), raw.end());
  return std::bit_cast<T>(raw);
}

}  // namespace

Result<Geoid> Geoid::load(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file)
    return fail(ErrorCode::Unavailable,
                fmt::format("no geoid grid at {}: install the Debian package proj-data", path));
  std::vector<char> header(kHeaderBytes);
  if (!file.read(header.data(), kHeaderBytes))
    return fail(ErrorCode::Corrupt, fmt::format("{} is shorter than a .gtx header", path));
  Geoid geoid;
  geoid.name_ = std::filesystem::path(path).stem().string();
  geoid.south_deg_ = bigEndian<double>(&header[0]);
  geoid.west_deg_ = bigEndian<double>(&header[8]);
  geoid.step_lat_deg_ = bigEndian<double>(&header[16]);
  geoid.step_lon_deg_ = bigEndian<double>(&header[24]);
  geoid.rows_ = bigEndian<std::int32_t>(&header[32]);
  geoid.columns_ = bigEndian<std::int32_t>(&header[36]);
  const bool plausible = std::abs(geoid.south_deg_) <= 90 && std::abs(geoid.west_deg_) <= 360 &&
                         geoid.step_lat_deg_ > 0 && geoid.step_lon_deg_ > 0 && geoid.rows_ >= 2 &&
                         geoid.columns_ >= 2 && geoid.rows_ <= 100000 && geoid.columns_ <= 100000 &&
                         geoid.south_deg_ + geoid.step_lat_deg_ * (geoid.rows_ - 1) <= 90.0001 &&
                         geoid.step_lon_deg_ * (geoid.columns_ - 1) <= 360.0001;
  if (!plausible) return fail(ErrorCode::Corrupt, fmt::format("{} has no .gtx header", path));
  geoid.around_ = geoid.step_lon_deg_ * geoid.columns_ > 359.9999;

  const std::size_t count = static_cast<std::size_t>(geoid.rows_) * static_cast<std::size_t>(geoid.columns_);
  std::error_code error;
  if (std::filesystem::file_size(path, error) != kHeaderBytes + 4 * count || error)
    return fail(ErrorCode::Corrupt, fmt::format("{} does not hold the {} x {} values that its header states",
                                                path, geoid.rows_, geoid.columns_));
  std::vector<char> bytes(4 * count);
  if (!file.read(bytes.data(), static_cast<std::streamsize>(bytes.size())))
    return fail(ErrorCode::Io, fmt::format("{} could not be read", path));
  auto grid = std::make_shared<std::vector<float>>(count);
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = bigEndian<float>(&bytes[4 * i]);
    (*grid)[i] = std::abs(value - kNoValue) < 1e-3F ? std::numeric_limits<float>::quiet_NaN() : value;
  }
  geoid.grid_ = std::move(grid);
  return geoid;
}

double Geoid::at(int row, int column) const {
  row = std::min(row, rows_ - 1);
  column = around_ ? column % columns_ : std::min(column, columns_ - 1);
  return (*grid_)[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
                  static_cast<std::size_t>(column)];
}

double Geoid::undulation(double lat, double lon) const {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const double y = (degrees(lat) - south_deg_) / step_lat_deg_;
  double east_deg = std::fmod(degrees(lon) - west_deg_, 360.0);
  if (east_deg < 0) east_deg += 360.0;
  const double x = east_deg / step_lon_deg_;
  constexpr double kSlack = 1e-9;  // of a cell, for places exactly on the edge
  if (!(y >= -kSlack && y <= rows_ - 1 + kSlack) || std::isnan(x)) return kNan;
  if (!around_ && !(x <= columns_ - 1 + kSlack)) return kNan;
  const int row = std::clamp(static_cast<int>(y), 0, rows_ - 1);
  const int column = std::clamp(static_cast<int>(x), 0, columns_ - 1);
  const double fy = y - row, fx = x - column;
  return (1 - fy) * ((1 - fx) * at(row, column) + fx * at(row, column + 1)) +
         fy * ((1 - fx) * at(row + 1, column) + fx * at(row + 1, column + 1));
}

}  // namespace overfly::geo
