#include "tiling/store/detail/rows.h"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <nlohmann/json.hpp>

namespace overfly::tiling::detail {
namespace {

static_assert(std::endian::native == std::endian::little, "the file's numbers are little-endian");

// position, quaternion (x, y, z, w), covariance row by row, time.
constexpr std::size_t kPoseBytes = (3 + 4 + 36) * sizeof(double) + sizeof(std::int64_t);

std::vector<std::uint8_t> bytesOf(const void* data, std::size_t size) {
  const auto* bytes = static_cast<const std::uint8_t*>(data);
  return {bytes, bytes + size};
}

std::vector<std::uint8_t> packPose(const capture::Pose& pose) {
  double values[43];
  for (int i = 0; i < 3; ++i) values[i] = pose.position_in_ecef[i];
  for (int i = 0; i < 4; ++i) values[3 + i] = pose.ecef_from_camera.coeffs()[i];
  for (int i = 0; i < 36; ++i) values[7 + i] = pose.covariance(i / 6, i % 6);
  std::vector<std::uint8_t> bytes = bytesOf(values, sizeof values);
  bytes.resize(kPoseBytes);
  std::memcpy(bytes.data() + sizeof values, &pose.time_ns, sizeof pose.time_ns);
  return bytes;
}

std::optional<capture::Pose> unpackPose(std::span<const std::uint8_t> bytes) {
  if (bytes.size() != kPoseBytes) return std::nullopt;
  double values[43];
  std::memcpy(values, bytes.data(), sizeof values);
  capture::Pose pose;
  for (int i = 0; i < 3; ++i) pose.position_in_ecef[i] = values[i];
  for (int i = 0; i < 4; ++i) pose.ecef_from_camera.coeffs()[i] = values[3 + i];
  for (int i = 0; i < 36; ++i) pose.covariance(i / 6, i % 6) = values[7 + i];
  std::memcpy(&pose.time_ns, bytes.data() + sizeof values, sizeof pose.time_ns);
  return pose;
}

std::vector<std::uint8_t> packFootprint(const geo::Footprint& footprint) {
  std::vector<double> values;
  const auto add = [&](const geo::Geodetic& point) {
    values.insert(values.end(), {point.lat, point.lon, point.height_m});
  };
  for (const geo::Geodetic& corner : footprint.corners) add(corner);
  add(footprint.centre);
  values.insert(values.end(), {footprint.gsd_m, footprint.height_above_m, footprint.tilt});
  return bytesOf(values.data(), values.size() * sizeof(double));
}

std::optional<geo::Footprint> unpackFootprint(std::span<const std::uint8_t> bytes) {
  double values[18];
  if (bytes.size() != sizeof values) return std::nullopt;
  std::memcpy(values, bytes.data(), sizeof values);
  geo::Footprint footprint;
  for (std::size_t i = 0; i < 4; ++i)
    footprint.corners[i] = {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
  footprint.centre = {values[12], values[13], values[14]};
  footprint.gsd_m = values[15];
  footprint.height_above_m = values[16];
  footprint.tilt = values[17];
  return footprint;
}

}  // namespace

std::uint32_t checksum(int space, const geo::TileKey& key, Layer layer, Codec codec, std::uint64_t revision,
                       std::span<const std::uint8_t> bytes) {
  const std::int64_t place[7] = {space,
                                 key.zoom,
                                 key.x,
                                 key.y,
                                 static_cast<std::int64_t>(layer),
                                 static_cast<std::int64_t>(codec),
                                 static_cast<std::int64_t>(revision)};
  const uLong head = crc32_z(0, reinterpret_cast<const Bytef*>(place), sizeof place);
  return static_cast<std::uint32_t>(bytes.empty() ? head : crc32_z(head, bytes.data(), bytes.size()));
}

std::vector<std::uint8_t> packFrameSet(std::vector<std::uint64_t> ids) {
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  std::vector<std::uint8_t> bytes;
  std::uint64_t last = 0;
  for (const std::uint64_t id : ids) {
    std::uint64_t rest = id - last;
    for (; rest >= 0x80; rest >>= 7) bytes.push_back(static_cast<std::uint8_t>(rest | 0x80));
    bytes.push_back(static_cast<std::uint8_t>(rest));
    last = id;
  }
  return bytes;
}

std::optional<std::vector<std::uint64_t>> unpackFrameSet(std::span<const std::uint8_t> bytes) {
  std::vector<std::uint64_t> ids;
  std::uint64_t last = 0, value = 0;
  unsigned shift = 0;
  for (const std::uint8_t byte : bytes) {
    if (shift > 63) return std::nullopt;
    value |= static_cast<std::uint64_t>(byte & 0x7f) << shift;
    shift += 7;
    if ((byte & 0x80) != 0) continue;
    last += value;
    ids.push_back(last);
    value = 0;
    shift = 0;
  }
  if (shift != 0) return std::nullopt;
  return ids;
}

std::string cameraText(const capture::CameraModel& camera) {
  const nlohmann::json json = {{"kind", static_cast<int>(camera.kind)},
                               {"width", camera.width},
                               {"height", camera.height},
                               {"fx", camera.fx},
                               {"fy", camera.fy},
                               {"cx", camera.cx},
                               {"cy", camera.cy},
                               {"distortion", camera.distortion}};
  return json.dump();
}

std::optional<capture::CameraModel> cameraFromText(const std::string& text) {
  const nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
  if (!json.is_object()) return std::nullopt;
  try {
    capture::CameraModel camera;
    camera.kind = static_cast<capture::CameraModel::Kind>(json.at("kind").get<int>());
    camera.width = json.at("width").get<int>();
    camera.height = json.at("height").get<int>();
    camera.fx = json.at("fx").get<double>();
    camera.fy = json.at("fy").get<double>();
    camera.cx = json.at("cx").get<double>();
    camera.cy = json.at("cy").get<double>();
    camera.distortion = json.at("distortion").get<std::vector<double>>();
    return camera;
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
}

Result<FrameRecord> frameFromRow(const Query& row) {
  FrameRecord frame;
  frame.id = static_cast<std::uint64_t>(row.integer(0));
  const auto damaged = [&](const char* what) {
    return fail(ErrorCode::Corrupt, fmt::format("the {} of frame {} is damaged", what, frame.id));
  };
  frame.name = row.text(1);
  frame.camera_id = row.text(2);
  frame.time_ns = row.integer(3);
  frame.utc_offset_ns = row.integer(4);
  frame.exposure_ns = row.integer(5);
  const std::int64_t datum = row.integer(6);
  if (datum < 0 || datum > static_cast<std::int64_t>(capture::VerticalDatum::Home)) return damaged("datum");
  frame.datum = static_cast<capture::VerticalDatum>(datum);
  frame.pose_is_adjusted = row.integer(7) != 0;
  if (!row.isNull(8) && !(frame.pose = unpackPose(row.blob(8)))) return damaged("pose");
  if (!row.isNull(9) && !(frame.footprint = unpackFootprint(row.blob(9)))) return damaged("footprint");
  if (!row.isNull(10)) frame.box = PlaneBox{row.real(10), row.real(11), row.real(12), row.real(13)};
  frame.path = row.text(14);
  frame.bytes = static_cast<std::uint64_t>(row.integer(15));
  const std::int64_t state = row.integer(16);
  if (state < 0 || state > static_cast<std::int64_t>(FrameState::Dropped)) return damaged("state");
  frame.state = static_cast<FrameState>(state);
  frame.reason = row.text(17);
  const auto camera = cameraFromText(row.text(18));
  if (!camera) return damaged("camera model");
  frame.camera = *camera;
  return frame;
}

Result<void> writeFrame(Database& database, const FrameRecord& frame) {
  if (frame.id > INT64_MAX) return fail(ErrorCode::BadInput, "a frame's id must be below 2^63");
  const std::string model = cameraText(frame.camera);
  {
    Query camera = database.query("INSERT OR IGNORE INTO camera (model) VALUES (?)");
    camera.bind(std::string_view(model));
    if (const Result<void> done = camera.run(); !done) return done;
  }
  const std::vector<std::uint8_t> pose = frame.pose ? packPose(*frame.pose) : std::vector<std::uint8_t>();
  const std::vector<std::uint8_t> footprint =
      frame.footprint ? packFootprint(*frame.footprint) : std::vector<std::uint8_t>();
  Query insert = database.query(
      "INSERT OR REPLACE INTO frame (id, name, camera_id, camera, time_ns, utc_offset_ns, exposure_ns, "
      "datum, "
      "pose_is_adjusted, pose, footprint, west, north, east, south, path, bytes, state, reason) VALUES (?, "
      "?, ?, "
      "(SELECT id FROM camera WHERE model = ?), ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.bind(frame.id)
      .bind(std::string_view(frame.name))
      .bind(std::string_view(frame.camera_id))
      .bind(std::string_view(model))
      .bind(frame.time_ns)
      .bind(frame.utc_offset_ns)
      .bind(frame.exposure_ns)
      .bind(static_cast<int>(frame.datum))
      .bind(static_cast<int>(frame.pose_is_adjusted));
  frame.pose ? insert.bind(std::span(pose)) : insert.bindNull();
  frame.footprint ? insert.bind(std::span(footprint)) : insert.bindNull();
  for (const double PlaneBox::*side : {&PlaneBox::west, &PlaneBox::north, &PlaneBox::east, &PlaneBox::south})
    frame.box ? insert.bind((*frame.box).*side) : insert.bindNull();
  insert.bind(std::string_view(frame.path))
      .bind(frame.bytes)
      .bind(static_cast<int>(frame.state))
      .bind(std::string_view(frame.reason));
  return insert.run();
}

}  // namespace overfly::tiling::detail
