#include "capture/record/detail/flight_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "capture/record/files.h"
#include "capture/record/json_value.h"
#include "capture/record/pose_check.h"

namespace overfly::capture {

const char* nameOf(VerticalDatum datum) {
  switch (datum) {
    case VerticalDatum::Unknown:
      return "unknown";
    case VerticalDatum::Ellipsoid:
      return "ellipsoid";
    case VerticalDatum::Geoid:
      return "geoid";
    case VerticalDatum::Home:
      return "home";
  }
  return "unknown";
}

const char* nameOf(PixelFormat format) {
  switch (format) {
    case PixelFormat::Grey8:
      return "grey8";
    case PixelFormat::Nv12:
      return "nv12";
    case PixelFormat::Rgb8:
      return "rgb8";
    case PixelFormat::Bgr8:
      return "bgr8";
    case PixelFormat::Jpeg:
      return "jpeg";
  }
  return "jpeg";
}

const char* nameOf(CameraModel::Kind kind) {
  switch (kind) {
    case CameraModel::Kind::Pinhole:
      return "pinhole";
    case CameraModel::Kind::RadialTangential:
      return "radial-tangential";
    case CameraModel::Kind::Fisheye:
      return "fisheye";
  }
  return "pinhole";
}

namespace detail {
namespace {

constexpr std::int64_t kMaxTime = std::int64_t{1} << 62;

template <typename Enum>
std::optional<Enum> valueOf(const std::optional<std::string>& name, std::initializer_list<Enum> all) {
  if (!name) return std::nullopt;
  for (const Enum value : all) {
    if (*name == nameOf(value)) return value;
  }
  return std::nullopt;
}

std::optional<VerticalDatum> datumFrom(const std::optional<std::string>& name) {
  return valueOf(
      name, {VerticalDatum::Unknown, VerticalDatum::Ellipsoid, VerticalDatum::Geoid, VerticalDatum::Home});
}

// Text from elsewhere may hold bytes that are not UTF-8: they become U+FFFD instead of an exception.
std::string dump(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

Json poseJson(const Pose& pose) {
  const auto& q = pose.ecef_from_camera;
  Json json = {{"time", pose.time_ns},
               {"ecef", {pose.position_in_ecef.x(), pose.position_in_ecef.y(), pose.position_in_ecef.z()}},
               {"q", {q.w(), q.x(), q.y(), q.z()}}};
  Json covariance = Json::array();
  const Eigen::Matrix<double, 6, 6> diagonal = pose.covariance.diagonal().asDiagonal();
  if (diagonal == pose.covariance) {
    for (Eigen::Index i = 0; i < 6; ++i) covariance.push_back(pose.covariance(i, i));
  } else {
    for (Eigen::Index i = 0; i < 36; ++i) covariance.push_back(pose.covariance(i / 6, i % 6));
  }
  json["cov"] = std::move(covariance);
  return json;
}

Result<Pose> poseFrom(const Json& json) {
  const auto time = integerIn(json, "time");
  const auto ecef = numbersIn(json, "ecef");
  const auto q = numbersIn(json, "q");
  const auto covariance = numbersIn(json, "cov");
  if (!time || !ecef || ecef->size() != 3 || !q || q->size() != 4 || !covariance ||
      (covariance->size() != 6 && covariance->size() != 36)) {
    return fail(ErrorCode::Corrupt, "its pose is not complete");
  }
  Pose pose;
  pose.time_ns = *time;
  pose.position_in_ecef = {(*ecef)[0], (*ecef)[1], (*ecef)[2]};
  pose.ecef_from_camera = Eigen::Quaterniond((*q)[0], (*q)[1], (*q)[2], (*q)[3]);
  for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(covariance->size()); ++i) {
    const double value = (*covariance)[static_cast<std::size_t>(i)];
    covariance->size() == 6 ? pose.covariance(i, i) = value : pose.covariance(i / 6, i % 6) = value;
  }
  if (const auto problem = checkPose(pose)) return fail(ErrorCode::Corrupt, "its pose is wrong: " + *problem);
  return pose;
}

Json optionalJson(const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); }

Json tripleJson(const std::optional<double>& a, const std::optional<double>& b,
                const std::optional<double>& c) {
  return Json::array({optionalJson(a), optionalJson(b), optionalJson(c)});
}

void readTriple(const Json& json, const char* key, std::optional<double>& a, std::optional<double>& b,
                std::optional<double>& c) {
  const Json* array = member(json, key);
  if (!array || !array->is_array() || array->size() != 3) return;
  std::optional<double>* into[3] = {&a, &b, &c};
  for (std::size_t i = 0; i < 3; ++i) {
    if ((*array)[i].is_number() && std::isfinite((*array)[i].get<double>()))
      *into[i] = (*array)[i].get<double>();
  }
}

Json rawJson(const RawTelemetry& raw) {
  return {{"lat", optionalJson(raw.lat)},
          {"lon", optionalJson(raw.lon)},
          {"alt", optionalJson(raw.altitude_m)},
          {"rel_alt", optionalJson(raw.relative_altitude_m)},
          {"gimbal", tripleJson(raw.gimbal_yaw, raw.gimbal_pitch, raw.gimbal_roll)},
          {"body", tripleJson(raw.body_yaw, raw.body_pitch, raw.body_roll)},
          {"std", tripleJson(raw.std_north_m, raw.std_east_m, raw.std_up_m)}};
}

RawTelemetry rawFrom(const Json& json) {
  RawTelemetry raw;
  raw.lat = numberIn(json, "lat");
  raw.lon = numberIn(json, "lon");
  raw.altitude_m = numberIn(json, "alt");
  raw.relative_altitude_m = numberIn(json, "rel_alt");
  readTriple(json, "gimbal", raw.gimbal_yaw, raw.gimbal_pitch, raw.gimbal_roll);
  readTriple(json, "body", raw.body_yaw, raw.body_pitch, raw.body_roll);
  readTriple(json, "std", raw.std_north_m, raw.std_east_m, raw.std_up_m);
  return raw;
}

}  // namespace

std::string infoText(const FlightInfo& info) {
  Json json = {{"format", "overfly-flight"},
               {"version", kVersion},
               {"made_by", info.made_by},
               {"source", info.source},
               {"datum", nameOf(info.datum)},
               {"datum_reason", info.datum_reason},
               {"origin", nullptr},
               {"ground_height", optionalJson(info.ground_height_m)},
               {"ground_reason", info.ground_reason},
               {"boot_id", info.boot_id},
               {"notes", info.notes}};
  if (info.datum == VerticalDatum::Geoid) json["geoid_model"] = info.geoid_model;
  if (info.origin) json["origin"] = {info.origin->lat, info.origin->lon, info.origin->height_m};
  return dump(json, 1) + "\n";
}

Result<FlightInfo> infoFromText(const std::string& text) {
  const auto json = parseJson(text);
  if (!json || !json->is_object()) return fail(ErrorCode::Corrupt, "it is not a JSON object");
  if (textIn(*json, "format") != "overfly-flight") {
    return fail(ErrorCode::Corrupt, "its \"format\" is not \"overfly-flight\"");
  }
  const auto version = integerIn(*json, "version");
  if (!version || *version < 1) return fail(ErrorCode::Corrupt, "it has no usable \"version\"");
  if (*version > kVersion) {
    return fail(ErrorCode::Unsupported,
                fmt::format("it is of version {}, this program reads up to {}: take a newer one", *version,
                            kVersion));
  }
  FlightInfo info;
  info.made_by = textIn(*json, "made_by").value_or("");
  info.source = textIn(*json, "source").value_or("");
  const auto datum = datumFrom(textIn(*json, "datum"));
  if (!datum) return fail(ErrorCode::Corrupt, "its \"datum\" is none of unknown, ellipsoid, geoid, home");
  info.datum = *datum;
  info.geoid_model = textIn(*json, "geoid_model").value_or("");
  info.datum_reason = textIn(*json, "datum_reason").value_or("");
  if (const auto origin = numbersIn(*json, "origin"); origin && origin->size() == 3) {
    info.origin = geo::Geodetic{(*origin)[0], (*origin)[1], (*origin)[2]};
  }
  info.ground_height_m = numberIn(*json, "ground_height");
  info.ground_reason = textIn(*json, "ground_reason").value_or("");
  info.boot_id = textIn(*json, "boot_id").value_or("");
  if (const Json* notes = member(*json, "notes"); notes && notes->is_array()) {
    for (const Json& note : *notes) {
      if (note.is_string()) info.notes.push_back(note.get<std::string>());
    }
  }
  return info;
}

std::string camerasText(const std::vector<FlightCamera>& cameras) {
  Json list = Json::array();
  for (const auto& [id, revision, model] : cameras) {
    list.push_back({{"id", id},
                    {"revision", revision},
                    {"kind", nameOf(model.kind)},
                    {"width", model.width},
                    {"height", model.height},
                    {"fx", model.fx},
                    {"fy", model.fy},
                    {"cx", model.cx},
                    {"cy", model.cy},
                    {"distortion", model.distortion}});
  }
  return dump({{"cameras", std::move(list)}}, 1) + "\n";
}

Result<std::vector<FlightCamera>> camerasFromText(const std::string& text) {
  const auto json = parseJson(text);
  const Json* list = json ? member(*json, "cameras") : nullptr;
  if (!list || !list->is_array()) return fail(ErrorCode::Corrupt, "it has no list \"cameras\"");
  std::vector<FlightCamera> cameras;
  for (const Json& item : *list) {
    FlightCamera camera;
    const auto id = textIn(item, "id");
    const auto revision = integerIn(item, "revision");
    const auto kind = valueOf(
        textIn(item, "kind"),
        {CameraModel::Kind::Pinhole, CameraModel::Kind::RadialTangential, CameraModel::Kind::Fisheye});
    const auto width = integerIn(item, "width"), height = integerIn(item, "height");
    const auto fx = numberIn(item, "fx"), fy = numberIn(item, "fy");
    const auto cx = numberIn(item, "cx"), cy = numberIn(item, "cy");
    const auto distortion = numbersIn(item, "distortion");
    const std::string name = id.value_or(fmt::format("number {}", cameras.size()));
    if (!id || !revision || !kind || !width || !height || !fx || !fy || !cx || !cy || !distortion ||
        *revision < 0 || *revision > 1'000'000 || *width != static_cast<int>(*width) ||
        *height != static_cast<int>(*height)) {
      return fail(ErrorCode::Corrupt, fmt::format("its camera {} is not complete", name));
    }
    camera.id = *id;
    camera.revision = static_cast<int>(*revision);
    camera.model.kind = *kind;
    camera.model.width = static_cast<int>(*width);
    camera.model.height = static_cast<int>(*height);
    camera.model.fx = *fx;
    camera.model.fy = *fy;
    camera.model.cx = *cx;
    camera.model.cy = *cy;
    camera.model.distortion = *distortion;
    if (const auto problem = camera.model.problem()) {
      return fail(ErrorCode::Corrupt, fmt::format("its camera {} cannot be: {}", name, *problem));
    }
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

std::string frameLine(const Frame& frame, int camera_revision, const std::string& file, std::uint64_t bytes,
                      std::uint32_t crc, const TelemetryPtr& raw) {
  Json json = {{"seq", frame.sequence},
               {"name", frame.name},
               {"file", file},
               {"camera", frame.camera_id},
               {"revision", camera_revision},
               {"time", frame.time_ns},
               {"utc_offset", frame.utc_offset_ns},
               {"exposure", frame.exposure_ns},
               {"gain", frame.gain},
               {"format", nameOf(frame.image.format)},
               {"width", frame.image.width},
               {"height", frame.image.height},
               {"stride", frame.image.stride},
               {"bytes", bytes},
               {"crc", crc},
               {"datum", nameOf(frame.datum)},
               {"adjusted", frame.pose_is_adjusted}};
  if (frame.time_sigma_ns > 0) json["time_sigma"] = frame.time_sigma_ns;
  if (frame.pose) json["pose"] = poseJson(*frame.pose);
  if (!frame.pose && !frame.no_pose_reason.empty()) json["no_pose"] = frame.no_pose_reason;
  if (raw) json["raw"] = rawJson(*raw);
  const std::string text = dump(json, -1);
  return fmt::format("{:08x} {}\n", crc32Of(bytesOf(text)), text);
}

Result<FlightFrame> frameFromLine(std::string_view line, const std::vector<FlightCamera>& cameras,
                                  VerticalDatum datum, const std::filesystem::path& images) {
  const auto wrong = [](const char* what) { return fail(ErrorCode::Corrupt, what); };
  std::uint32_t crc = 0;
  if (line.size() > kMaxLine) return wrong("it is too long");
  if (line.size() < 10 || line[8] != ' ' ||
      std::from_chars(line.data(), line.data() + 8, crc, 16).ptr != line.data() + 8) {
    return wrong("it does not begin with a checksum");
  }
  const std::string text(line.substr(9));
  if (crc32Of(bytesOf(text)) != crc) return wrong("its checksum is wrong");
  const auto json = parseJson(text);
  if (!json || !json->is_object()) return wrong("it is not a JSON object");

  FlightFrame result;
  Frame& frame = result.frame;
  const Json* sequence = member(*json, "seq");
  if (!sequence || !sequence->is_number_unsigned()) return wrong("its \"seq\" is not a number");
  frame.sequence = sequence->get<std::uint64_t>();
  frame.name = textIn(*json, "name").value_or("");
  const auto file = textIn(*json, "file");
  if (!file || !isPlainFileName(*file)) return wrong("its \"file\" is not a file name");
  result.file = (images / *file).string();
  const auto camera_id = textIn(*json, "camera");
  const auto revision = integerIn(*json, "revision");
  const auto camera = std::find_if(cameras.begin(), cameras.end(), [&](const FlightCamera& c) {
    return camera_id == c.id && revision == c.revision;
  });
  if (camera == cameras.end()) return wrong("its camera is not in cameras.json");
  frame.camera_id = camera->id;
  frame.camera = camera->model;
  const auto time = integerIn(*json, "time"), utc_offset = integerIn(*json, "utc_offset");
  const auto exposure = integerIn(*json, "exposure");
  if (!time || std::abs(*time) > kMaxTime || !utc_offset || std::abs(*utc_offset) > kMaxTime || !exposure ||
      *exposure < 0) {
    return wrong("its times are not usable");
  }
  frame.time_ns = *time;
  frame.utc_offset_ns = *utc_offset;
  frame.exposure_ns = *exposure;
  frame.time_sigma_ns = std::clamp<std::int64_t>(integerIn(*json, "time_sigma").value_or(0), 0, kMaxTime);
  frame.no_pose_reason = textIn(*json, "no_pose").value_or("");
  frame.gain = numberIn(*json, "gain").value_or(0);
  const auto format = valueOf(
      textIn(*json, "format"),
      {PixelFormat::Jpeg, PixelFormat::Grey8, PixelFormat::Nv12, PixelFormat::Rgb8, PixelFormat::Bgr8});
  const auto width = integerIn(*json, "width"), height = integerIn(*json, "height");
  const auto stride = integerIn(*json, "stride"), bytes = integerIn(*json, "bytes"),
             image_crc = integerIn(*json, "crc");
  constexpr std::int64_t kMaxInt = std::numeric_limits<int>::max();
  if (!format || !width || *width < 0 || *width > kMaxInt || !height || *height < 0 || *height > kMaxInt ||
      !stride || *stride < 0 || *stride > kMaxInt || !bytes || *bytes < 0 || !image_crc || *image_crc < 0 ||
      *image_crc > std::numeric_limits<std::uint32_t>::max()) {
    return wrong("its image is not described");
  }
  frame.image.format = *format;
  frame.image.width = static_cast<int>(*width);
  frame.image.height = static_cast<int>(*height);
  frame.image.stride = static_cast<int>(*stride);
  result.bytes = static_cast<std::uint64_t>(*bytes);
  result.crc = static_cast<std::uint32_t>(*image_crc);
  frame.datum = datumFrom(textIn(*json, "datum")).value_or(datum);
  if (const Json* adjusted = member(*json, "adjusted"); adjusted && adjusted->is_boolean()) {
    frame.pose_is_adjusted = adjusted->get<bool>();
  }
  if (const Json* pose = member(*json, "pose")) {
    auto read = poseFrom(*pose);
    if (!read) return tl::unexpected(read.error());
    frame.pose = *read;
  }
  if (const Json* raw = member(*json, "raw"); raw && raw->is_object())
    result.raw = std::make_shared<const RawTelemetry>(rawFrom(*raw));
  return result;
}

bool isPlainFileName(std::string_view name) {
  return !name.empty() && name.size() <= 200 && name.front() != '.' && name.front() != '-' &&
         std::all_of(name.begin(), name.end(), [](unsigned char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '.' ||
                  c == '_' || c == '-';
         });
}

}  // namespace detail
}  // namespace overfly::capture
