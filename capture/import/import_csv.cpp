#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "capture/geo/geodetic.h"
#include "capture/import/camera_file.h"
#include "capture/import/csv_table.h"
#include "capture/import/detail/importers.h"
#include "capture/import/device_pose.h"
#include "capture/record/files.h"
#include "capture/record/pose_check.h"

namespace overfly::capture::detail {
namespace {

constexpr std::uint64_t kMaxTable = 256u << 20;
// A bundle adjustment's poses: a few centimetres and half a milliradian (about half a pixel at 1000 px of
// focal length), which is what a reprojection error below 1 px leaves.
constexpr double kAdjustedHorizontal_m = 0.02, kAdjustedVertical_m = 0.03, kAdjustedAngle = 0.0005;
// x, y, z and lat, lon, alt are two spellings of one place.
constexpr double kSamePlace_m = 1.0;

std::optional<double> anglesOf(const CsvTable& table, std::size_t row, const char* column) {
  const auto value = table.number(row, column);
  if (!value || std::abs(*value) > 720) return std::nullopt;
  return geo::radians(*value);
}

// What the device wrote, as far as the row has it.
RawTelemetry rawOf(const CsvTable& table, std::size_t row) {
  RawTelemetry raw;
  const auto lat = table.number(row, "raw_lat"), lon = table.number(row, "raw_lon");
  if (lat && lon && std::abs(*lat) <= 90 && std::abs(*lon) <= 360) {
    raw.lat = geo::radians(*lat);
    raw.lon = geo::radians(*lon);
  }
  const auto height = [&](const char* column) {
    const auto value = table.number(row, column);
    return value && std::abs(*value) < 20000 ? value : std::nullopt;
  };
  raw.altitude_m = height("raw_alt");
  raw.relative_altitude_m = height("raw_rel_alt");
  raw.gimbal_yaw = anglesOf(table, row, "raw_gimbal_yaw_deg");
  raw.gimbal_pitch = anglesOf(table, row, "raw_gimbal_pitch_deg");
  raw.gimbal_roll = anglesOf(table, row, "raw_gimbal_roll_deg");
  raw.body_yaw = anglesOf(table, row, "raw_flight_yaw_deg");
  raw.body_pitch = anglesOf(table, row, "raw_flight_pitch_deg");
  raw.body_roll = anglesOf(table, row, "raw_flight_roll_deg");
  return raw;
}

Result<Pose> adjustedPose(const CsvTable& table, std::size_t row, const geo::LocalFrame& local,
                          std::int64_t time_ns) {
  const auto lat = table.number(row, "lat"), lon = table.number(row, "lon"), alt = table.number(row, "alt");
  const auto x = table.number(row, "x"), y = table.number(row, "y"), z = table.number(row, "z");
  const auto qw = table.number(row, "qw"), qx = table.number(row, "qx"), qy = table.number(row, "qy"),
             qz = table.number(row, "qz");
  if (!x || !y || !z || !qw || !qx || !qy || !qz) {
    return fail(ErrorCode::BadInput, "x, y, z, qw, qx, qy, qz are not all numbers");
  }
  Pose pose;
  pose.time_ns = time_ns;
  pose.position_in_ecef = local.ecefFromEnu({*x, *y, *z});
  if (lat && lon && alt) {
    if (std::abs(*lat) > 90 || std::abs(*lon) > 360)
      return fail(ErrorCode::BadInput, "lat, lon are not on Earth");
    const Eigen::Vector3d again = geo::ecefFromGeodetic({geo::radians(*lat), geo::radians(*lon), *alt});
    const double apart = (again - pose.position_in_ecef).norm();
    if (!(apart < kSamePlace_m)) {
      return fail(ErrorCode::BadInput, fmt::format("x, y, z and lat, lon, alt are {:.3g} m apart", apart));
    }
  }
  const Eigen::Quaterniond enu_from_camera(*qw, *qx, *qy, *qz);
  const double length = enu_from_camera.norm();
  if (!(std::abs(length - 1) < 0.01)) {
    return fail(ErrorCode::BadInput, fmt::format("the quaternion's length is {:.4g}, not 1", length));
  }
  const Eigen::Quaterniond ecef_from_enu(local.enuFromEcefRotation().transpose());
  pose.ecef_from_camera = (ecef_from_enu * enu_from_camera).normalized();
  const auto variance = [](double sigma) { return sigma * sigma; };
  pose.covariance.diagonal() << variance(kAdjustedHorizontal_m), variance(kAdjustedHorizontal_m),
      variance(kAdjustedVertical_m), variance(kAdjustedAngle), variance(kAdjustedAngle),
      variance(kAdjustedAngle);
  if (const auto problem = checkPose(pose)) return fail(ErrorCode::BadInput, *problem);
  return pose;
}

// Sparse points of the adjustment tell the height of the ground.
void readGround(const std::filesystem::path& folder, double origin_height_m, FlightInfo& info) {
  const auto text = readText(folder / "reference_points.csv", kMaxTable);
  if (!text) return;
  const auto table = CsvTable::parse(*text);
  if (!table) return;
  std::vector<double> heights;
  for (std::size_t row = 0; row < table->rows(); ++row) {
    if (const auto z = table->number(row, "z"); z && std::abs(*z) < 20000) heights.push_back(*z);
  }
  if (heights.size() < 10) return;
  const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
  std::nth_element(heights.begin(), middle, heights.end());
  info.ground_height_m = origin_height_m + *middle;
  info.ground_reason = fmt::format("median of {} reference points", heights.size());
}

}  // namespace

Result<Flight> importCsv(const std::filesystem::path& folder, const ImportOptions& options) {
  const auto csv = folder / "flight.csv";
  const auto wrong = [&](const std::string& what) {
    return fail(ErrorCode::BadInput, fmt::format("{}: {}", csv.string(), what));
  };
  const auto text = readText(csv, kMaxTable);
  if (!text) return tl::unexpected(text.error());
  const auto table = CsvTable::parse(*text);
  if (!table) return wrong(table.error().message);
  std::vector<std::string> needed = {"filename", "timestamp_ns"};
  const std::vector<std::string> own = options.raw
                                           ? std::vector<std::string>{"raw_lat", "raw_lon"}
                                           : std::vector<std::string>{"x", "y", "z", "qw", "qx", "qy", "qz"};
  needed.insert(needed.end(), own.begin(), own.end());
  for (const std::string& column : needed) {
    if (!table->has(column)) {
      const bool other =
          !options.raw && table->has("raw_lat") && column != "filename" && column != "timestamp_ns";
      return wrong(fmt::format("the column \"{}\" is missing{}", column,
                               other ? "; what the device recorded is there: import it with --raw" : ""));
    }
  }
  const auto camera = readCameraFile(options.camera_file.value_or(folder / "camera.json"));
  if (!camera) {
    return fail(ErrorCode::BadInput, camera.error().message);
  }
  if (!camera->enu_origin && !options.raw) return wrong("the camera file has no \"enu_origin\" for x, y, z");

  FlightInfo info;
  info.made_by = "overfly import";
  info.source = std::filesystem::absolute(folder).lexically_normal().string();
  info.datum = VerticalDatum::Unknown;
  info.datum_reason =
      camera->altitude_kind.empty()
          ? "the folder does not say what its altitudes are counted from; they pass through unshifted"
          : fmt::format(
                "the folder says of its altitudes: \"{}\"; that names no datum that can be relied "
                "on, so they pass through unshifted",
                camera->altitude_kind);
  info.origin = camera->enu_origin;
  info.boot_id = "utc";
  info.notes = {camera->convention, "times are UTC, not a boot clock's"};
  info.notes.push_back(options.raw ? "poses are what the device recorded"
                                   : "poses come from a bundle adjustment");

  const std::optional<geo::LocalFrame> local =
      camera->enu_origin ? std::optional<geo::LocalFrame>(*camera->enu_origin) : std::nullopt;
  std::vector<FlightFrame> frames;
  std::set<std::string> names;
  Skips skips;
  for (std::size_t row = 0; row < table->rows(); ++row) {
    const auto skip = [&](const std::string& why) {
      skips.add(fmt::format("{}, line {} is skipped: {}", csv.string(), table->lineOf(row), why));
    };
    if (!table->complete(row)) {
      skip("it has another number of cells than the header");
      continue;
    }
    const std::string name = *table->text(row, "filename");
    const std::filesystem::path file(name);
    if (name.empty() || file.filename() != file || name == "." || name == "..") {
      skip("its file name is not one");
      continue;
    }
    if (!names.insert(name).second) {
      skip(fmt::format("{} was there before", name));
      continue;
    }
    const auto time = table->integer(row, "timestamp_ns");
    if (!time || *time < 0 || *time > (std::int64_t{1} << 62)) {
      skip("its time is not usable");
      continue;
    }
    FlightFrame entry;
    entry.file = (folder / "images" / file).string();
    Frame& frame = entry.frame;
    frame.sequence = row;
    frame.name = name;
    frame.camera_id = "main";
    frame.camera = camera->model;
    frame.time_ns = *time;
    frame.image.width = camera->model.width;
    frame.image.height = camera->model.height;
    RawTelemetry raw = rawOf(*table, row);
    if (options.raw) {
      auto pose = devicePose(raw, *time);
      if (pose && checkPose(*pose)) pose.reset();
      frame.pose = pose;
    } else {
      const auto pose = adjustedPose(*table, row, *local, *time);
      if (!pose) {
        skip(pose.error().message);
        continue;
      }
      frame.pose = *pose;
      frame.pose_is_adjusted = true;
    }
    if (!raw.empty()) entry.raw = std::make_shared<const RawTelemetry>(raw);
    std::error_code code;
    if (!std::filesystem::is_regular_file(entry.file, code)) {
      skip(fmt::format("there is no image {}", entry.file));
      continue;
    }
    frames.push_back(std::move(entry));
  }
  if (frames.empty()) {
    return wrong(skips.warnings.empty() ? "it has no rows"
                                        : "no row is usable; the first: " + skips.warnings.front());
  }
  if (options.raw) {
    groundFromTakeOff(frames, info);
  } else if (camera->enu_origin) {
    readGround(folder, camera->enu_origin->height_m, info);
    if (!info.ground_height_m) groundFromTakeOff(frames, info);
  }
  return Flight(std::move(info), {{"main", 0, camera->model}}, std::move(frames), std::move(skips.warnings),
                skips.count);
}

}  // namespace overfly::capture::detail
